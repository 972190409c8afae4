"""Driving on a highway: three lanes, grass on both sides, two slower cars.

The paper tells of its simulator in a few sentences (section 5.2); the cells, the features
and how cars come back are ours.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np

from gridworld_bench.mdp import Mdp, Solution, solve
from tablesetting.irl.arrays import Array, Booleans, Indices, normalize_l1

ACTIONS = ("left", "stay", "right")
"""What the driver can do; the sides of the road end at the grass."""
POSITIONS = ("left grass", "left lane", "middle lane", "right lane", "right grass")
"""Where the driver can be."""
FEATURES = (
    *("grass", "left lane", "middle lane", "right lane"),
    *("collision", "car beside", "car 1 ahead", "car 2 ahead", "car 3 ahead"),
)
"""What a reward depends on: each is 1 where it holds, else 0."""
DRIVERS: Mapping[str, Mapping[str, float]] = {
    "safe": {
        "grass": -0.3,
        "collision": -0.5,
        "car 1 ahead": -0.15,
        "car 2 ahead": -0.05,
    },
    "right-lane": {"right lane": 0.3, "grass": -0.2, "collision": -0.5},
    "reckless": {"middle lane": 0.5, "collision": 0.5},
}
"""What each scripted driver wants; what is not named does not matter."""

STAY = ACTIONS.index("stay")
_LANES = (1, 2, 3)
_DISCOUNT = 0.9
_ENTERS = 0.3  # Probability that a car enters, if the other is on the road.
_FARTHEST = 3  # Distance, in steps, up to which a car ahead is a feature.

Car = tuple[int, int]
"""Lane, from 1 on the left to 3, and how many steps ahead it is."""


@dataclass(frozen=True, order=True)
class Situation:
    """Where the driver and the others are.

    Attributes:
        agent: The driver's position, see `POSITIONS`.
        cars: The cars on the road, at most two, in order.
    """

    agent: int
    cars: tuple[Car, ...]

    @property
    def is_on_grass(self) -> bool:
        """Whether the driver has left the road."""
        return self.agent not in _LANES

    @property
    def is_collision(self) -> bool:
        """Whether the driver is where another car is."""
        return (self.agent, 0) in self.cars


class Highway:
    """A road on which the driver overtakes two cars, again and again.

    The driver goes twice as fast as they do: seen from there, a car comes one step closer
    at every step. One that has been passed comes back at the far end after some time, in
    any lane. The driver changes lanes at once.

    Attributes:
        length: How many steps ahead the road is seen.
        situations: All situations; the index is the state of the MDP.
    """

    def __init__(self, length: int = 10):
        """Number the situations.

        Args:
            length: How many steps ahead the road is seen, at least 2.

        Raises:
            ValueError: If it is shorter.
        """
        if length < 2:
            raise ValueError(f"`length` must be at least 2; got {length}")
        self.length = length
        cells = [(lane, distance) for lane in _LANES for distance in range(length)]
        pairs = [tuple(cars) for num in range(3) for cars in combinations(cells, num)]
        # By what is still to be passed: one step leads to what is near in memory.
        self._pairs = sorted(pairs, key=lambda cars: sum(each[1] + 1 for each in cars))
        self.situations = [
            Situation(agent, cars)
            for cars, agent in product(self._pairs, range(len(POSITIONS)))
        ]
        self._index = {each: state for state, each in enumerate(self.situations)}

    def state_of(self, situation: Situation) -> int:
        """Return the state that a situation is.

        Raises:
            ValueError: If there is no such situation on this road.
        """
        cars = tuple(sorted(situation.cars))
        state = self._index.get(Situation(situation.agent, cars))
        if state is None:
            raise ValueError(f"{situation} is not on a road of length {self.length}")
        return state

    @cached_property
    def mdp(self) -> Mdp:
        """The road as an MDP, in which driving starts anywhere and never ends."""
        num_pairs, num_states = len(self._pairs), len(self.situations)
        place = {cars: k for k, cars in enumerate(self._pairs)}
        moves = [self._move(cars) for cars in self._pairs]
        most = max(map(len, moves))
        reached = np.zeros((num_pairs, most), dtype=np.intp)
        chances = np.zeros((num_pairs, most))
        for k, move in enumerate(moves):
            reached[k, : len(move)] = [place[cars] for cars in move]
            chances[k, : len(move)] = list(move.values())
        agents = np.arange(len(POSITIONS))[:, None] + np.arange(-1, 2)
        agents = agents.clip(0, len(POSITIONS) - 1)  # (X, A)
        shape = (num_pairs, len(POSITIONS), len(ACTIONS), most)
        successors = reached[:, None, None] * len(POSITIONS) + agents[None, :, :, None]
        return Mdp(
            successors.reshape(num_states, *shape[2:]),
            np.broadcast_to(chances[:, None, None], shape).reshape(
                num_states, *shape[2:]
            ),
            np.array([_features(each) for each in self.situations]),
            discount=_DISCOUNT,
            initial_states=np.arange(num_states),
            is_terminal=np.zeros(num_states, dtype=bool),
        )

    def _move(self, cars: tuple[Car, ...]) -> dict[tuple[Car, ...], float]:
        """Return how probable each place of the cars is at the next step.

        That two cars enter the same lane at once is excluded, and the rest made to sum
        to 1: with both away, each enters a little less often than one alone.
        """
        kept = [(lane, distance - 1) for lane, distance in cars if distance > 0]
        options = {None: 1.0 - _ENTERS} | dict.fromkeys(_LANES, _ENTERS / len(_LANES))
        found: dict[tuple[Car, ...], float] = {}
        for lanes in product(options, repeat=2 - len(kept)):
            entering = [lane for lane in lanes if lane is not None]
            if len(set(entering)) == len(entering):  # No two in one place.
                new = kept + [(lane, self.length - 1) for lane in entering]
                chance = float(np.prod([options[lane] for lane in lanes]))
                key = tuple(sorted(new))
                found[key] = found.get(key, 0.0) + chance
        total = sum(found.values())
        return {key: chance / total for key, chance in found.items()}

    def driver_policy(self, driver: str) -> Indices:
        """Return what a scripted driver does in each state, shape (S,).

        Raises:
            KeyError: If there is no such driver.
        """
        return drive_best(solve(self.mdp, self.mdp.rewards(driver_weights(driver))))

    @cached_property
    def is_collision(self) -> Booleans:
        """Where the driver collides, shape (S,)."""
        return self.mdp.features[:, FEATURES.index("collision")] > 0.0

    @cached_property
    def is_on_grass(self) -> Booleans:
        """Where the driver is on the grass, shape (S,)."""
        return self.mdp.features[:, FEATURES.index("grass")] > 0.0


def driver_weights(driver: str) -> Array:
    """Return the reward weights of a scripted driver, shape (D,).

    Raises:
        KeyError: If there is no such driver.
    """
    wanted = DRIVERS[driver]
    return normalize_l1(np.array([wanted.get(name, 0.0) for name in FEATURES]))


def drive_best(solution: Solution) -> Indices:
    """Return a best action in each state, to stay wherever that is as good, shape (S,)."""
    best = solution.is_optimal.argmax(axis=1)
    return np.where(solution.is_optimal[:, STAY], STAY, best)


def stationary_probabilities(mdp: Mdp, policy: Indices) -> Array:
    """Return how much of the time a policy spends in each state, shape (S,).

    It starts anywhere, each state as probably, which matters if it never leaves some part.
    """
    transitions = mdp.transitions(policy).T.tocsr()
    chances = np.full(mdp.num_states, 1.0 / mdp.num_states)
    for _ in range(100_000):
        # Half of each step is to stay, lest a cycle go on for ever.
        new = 0.5 * (chances + transitions @ chances)
        if np.abs(new - chances).sum() < 1e-12:
            break
        chances = new
    return np.asarray(new / new.sum())


def _features(situation: Situation) -> list[float]:
    lane, cars = situation.agent, situation.cars
    found = {"grass"} if situation.is_on_grass else {POSITIONS[lane]}
    if situation.is_collision:
        found.add("collision")
    if not situation.is_on_grass:
        if {(lane - 1, 0), (lane + 1, 0)} & set(cars):
            found.add("car beside")
        ahead = [distance for there, distance in cars if there == lane and distance]
        if ahead and min(ahead) <= _FARTHEST:
            found.add(f"car {min(ahead)} ahead")
    return [float(name in found) for name in FEATURES]
