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
