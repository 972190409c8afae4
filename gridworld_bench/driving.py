"""Learning to drive from a drive, and from answers in sampled situations."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from gridworld_bench.drives import Drive
from gridworld_bench.highway import (
    POSITIONS,
    Highway,
    Situation,
    drive_best,
    driver_weights,
    stationary_probabilities,
)
from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import Mdp
from gridworld_bench.posterior import MdpPosterior
from gridworld_bench.problem import MdpConfig, MdpProblem, Proposer
from gridworld_bench.queries import Query, roll_out, step
from tablesetting.irl.arrays import Array, Indices

Answer = Callable[[int], int]
"""Returns what to do in a state."""

NUM_RISKIEST = 10
"""Sampled states, the riskiest ones, that are looked at."""


class DrivingProblem(MdpProblem):
    """A highway with somebody who drives; implements `irl.active.Problem`.

    Attributes:
        highway: The road.
        policy: What the scripted driver does in each state, shape (S,).
    """

    def __init__(
        self,
        highway: Highway,
        driver: str,
        config: MdpConfig,
        propose: Proposer,
        answer: Answer | None = None,
    ):
        """Solve the road for the scripted driver.

        Args:
            highway: The road.
            driver: Name of the driver, see `highway.DRIVERS`.
            config: How the reward is learned.
            propose: Makes the candidate queries.
            answer: Who answers them; the scripted driver if None.
        """
        super().__init__(highway.mdp, driver_weights(driver), config, propose)
        self.highway = highway
        self.policy = drive_best(self.truth)
        self._answer = answer

    @cached_property
    def time_spent(self) -> Array:
        """Share of the time that the scripted driver spends in each state, shape (S,)."""
        return stationary_probabilities(self.mdp, self.policy)

    def demonstrate(self, query: Query, *, rng: np.random.Generator) -> Evidence:
        """Ask the driver what to do."""
        ask = self._answer or self.policy.__getitem__
        return Evidence.of_pairs([(query.start, int(ask(query.start)))])


def drive(
    highway: Highway, driver: str, num_steps: int, *, rng: np.random.Generator
) -> Drive:
    """Let a scripted driver drive from a random situation on the road.

    Raises:
        KeyError: If there is no such driver.
    """
    start, policy = int(rng.choice(road_starts(highway))), highway.driver_policy(driver)
    path = roll_out(highway.mdp, policy, start, num_steps, rng=rng)
    assert path.actions is not None
    states, actions = tuple(path.states.tolist()), tuple(path.actions.tolist())
    return Drive(highway, states, actions, driver)


def road_starts(highway: Highway) -> Indices:
    """Return states on the road without a collision, in which a drive can start."""
    return np.flatnonzero(~(highway.is_on_grass | highway.is_collision))


def draw_states(mdp: Mdp, num: int, *, rng: np.random.Generator) -> Indices:
    """Draw distinct states, all S if there are no more, shape (min(num, S),)."""
    return rng.choice(mdp.num_states, size=min(num, mdp.num_states), replace=False)


def sample_states(num: int) -> Proposer:
    """Ask for the best action in any of some states that are drawn anew every time."""
    return partial(_propose_sampled, num)


def _propose_sampled(
    num: int, mdp: Mdp, posterior: MdpPosterior, rng: np.random.Generator
) -> list[Query]:
    return [Query(np.array([state])) for state in draw_states(mdp, num, rng=rng)]


def go_on_driving(driven: Drive) -> Proposer:
    """Ask nothing but what to do next on a drive."""
    return partial(_propose_next, driven)


def _propose_next(
    driven: Drive, mdp: Mdp, posterior: MdpPosterior, rng: np.random.Generator
) -> list[Query]:
    known = min(len(posterior.evidence.states), len(driven.states) - 1)
    return [Query(np.array([driven.states[known]]))]


@dataclass(frozen=True)
class Riskiest:
    """Sampled states with the largest values at risk.

    Attributes:
        states: The states, the riskiest first, shape (R,).
        var: Value at risk of each, shape (R,).
    """

    states: Indices
    var: Array


def find_riskiest(states: Indices, var: Array) -> Riskiest:
    """Return the riskiest of some states, at most `NUM_RISKIEST` of them.

    Args:
        states: States, shape (K,).
        var: Value at risk of each, shape (K,).
    """
    order = (-var).argsort(kind="stable")[:NUM_RISKIEST]
    return Riskiest(states[order], var[order])


@dataclass(frozen=True)
class Record:
    """What happened to a policy on the road.

    Attributes:
        collisions: Steps at which it was where another car was.
        off_road: Steps on the grass.
    """

    collisions: int
    off_road: int


def try_out(
    highway: Highway,
    policy: Indices,
    num_steps: int = 1000,
    *,
    rng: np.random.Generator,
) -> Record:
    """Follow a policy, shape (S,), from an empty middle lane; count what went wrong."""
    state = highway.state_of(Situation(POSITIONS.index("middle lane"), ()))
    collisions = off_road = 0
    for _ in range(num_steps):
        state = step(highway.mdp, state, int(policy[state]), rng=rng)
        collisions += int(highway.is_collision[state])
        off_road += int(highway.is_on_grass[state])
    return Record(collisions, off_road)
