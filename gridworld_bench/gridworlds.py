"""Grid worlds of the paper."""

from collections.abc import Sequence

import numpy as np

from gridworld_bench.grid import ACTIONS, grid_successors
from gridworld_bench.mdp import Mdp
from tablesetting.irl.arrays import Array, normalize_l1

DISCOUNT = 0.95


def make_grid(
    features: Array,
    num_columns: int,
    *,
    initial_states: Sequence[int] | None = None,
    terminal_states: Sequence[int] = (),
    discount: float = DISCOUNT,
    slip: float = 0.0,
) -> Mdp:
    """Make a world of cells, in which an action moves to the next one.

    Args:
        features: Features of each cell, row by row, shape (S, D).
        num_columns: Cells in a row.
        initial_states: Where an episode can start; anywhere if None.
        terminal_states: Where it ends.
        discount: The discount.
        slip: How probable it is that another action than the one that was chosen, each
            as probable as the others, takes place.

    Returns:
        The MDP; with a slip, each action leads to as many states as there are actions.
    """
    num_states = len(features)
    successors = grid_successors(num_states // num_columns, num_columns)
    probabilities = np.ones(successors.shape)
    if slip > 0.0:
        num_actions = len(ACTIONS)
        every = successors[:, None, :, 0].repeat(num_actions, axis=1)
        chances = np.full((num_actions, num_actions), slip / (num_actions - 1))
        np.fill_diagonal(chances, 1.0 - slip)
        successors = every
        probabilities = np.broadcast_to(chances, every.shape).copy()
    is_terminal = np.zeros(num_states, dtype=bool)
    is_terminal[list(terminal_states)] = True
    starts = np.arange(num_states) if initial_states is None else initial_states
    return Mdp(
        successors=successors,
        probabilities=probabilities,
        features=np.ascontiguousarray(features, dtype=np.float64),
        discount=discount,
        initial_states=np.asarray(starts, dtype=np.intp),
        is_terminal=is_terminal,
    )


def random_world(
    size: int = 8, num_features: int = 48, *, rng: np.random.Generator
) -> tuple[Mdp, Array]:
    """Draw a square world of random continuous features, and what is wanted there.

    Args:
        size: Cells on each side.
        num_features: Features of each cell, uniform in [0, 1).
        rng: Source of features and weights.

    Returns:
        The world, and the true weights, uniform on the L1 sphere, shape (D,).
    """
    features = rng.random((size * size, num_features))
    weights = normalize_l1(rng.laplace(size=(1, num_features)))[0]
    return make_grid(features, size), weights


EXAMPLE = ("gwwbw", "wywbw", "wywbw", "wwwbw")
"""Green is wanted; blue cannot be avoided from the right, yellow can."""

_EXAMPLE_WEIGHTS = {"w": -0.05, "y": -0.25, "g": 0.5, "b": -0.2}


def color_world(
    cells: Sequence[str], colors: str, *, initial_color: str | None = None
) -> Mdp:
    """Make a world of cells whose feature is their color.

    Args:
        cells: The color of each cell, a letter each, row by row.
        colors: All colors, in the order of the features.
        initial_color: Color of the cells in which an episode can start; any if None.
    """
    letters = "".join(cells)
    features = np.array([[each == color for color in colors] for each in letters])
    starts = None
    if initial_color is not None:
        starts = [state for state, each in enumerate(letters) if each == initial_color]
    return make_grid(features.astype(np.float64), len(cells[0]), initial_states=starts)


def example_world() -> tuple[Mdp, Array]:
    """Make a world such as that of Figure 1 of the paper, whose cells are not given.

    Returns:
        The world, which starts in white cells, and the true weights, shape (4,).
    """
    colors = "".join(_EXAMPLE_WEIGHTS)
    mdp = color_world(EXAMPLE, colors, initial_color="w")
    return mdp, normalize_l1(np.array(list(_EXAMPLE_WEIGHTS.values())))


def barrier_world(
    size: int = 8,
    num_colors: int = 6,
    *,
    num_starts: int | None = None,
    rng: np.random.Generator,
) -> tuple[Mdp, Array]:
    """Draw a sparse world such as that of appendix A, whose cells are not given.

    One cell of the top row is wanted, and ends an episode. The middle row is a barrier of
    several colors, each bad to its own degree; all other cells are slightly bad.

    Args:
        size: Cells on each side, at least 3.
        num_colors: Colors of the barrier.
        num_starts: Cells of the bottom row in which an episode can start; anywhere if
            None.
        rng: Source of the world and of what is wanted.

    Returns:
        The world, and the true weights, shape (2 + C,).
    """
    barrier = np.arange(size) % num_colors + 2
    cells = np.ones((size, size), dtype=np.intp)
    goal = int(rng.integers(size))
    cells[0, goal] = 0
    cells[size // 2] = rng.permutation(barrier)
    weights = np.concatenate(
        [[1.0, -rng.uniform(0.0, 0.1)], -rng.uniform(0.1, 1.0, num_colors)]
    )
    features = np.eye(2 + num_colors)[cells.ravel()]
    starts = None
    if num_starts is not None:
        starts = (size * (size - 1) + rng.permutation(size)[:num_starts]).tolist()
    mdp = make_grid(features, size, initial_states=starts, terminal_states=[goal])
    return mdp, normalize_l1(weights)
