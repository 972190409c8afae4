"""Whether demonstrations are such as the model of the person would give."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.reward.config import PlacementConfig
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import all_centers, rbf_features
from tablesetting.reward.square import cell_centers

_NUM_ANSWERS = 8  # Of each sample: few would hide how unlikely a blunder is.
_CELLS_PER_SIDE = 32  # Of the square, for the answers of a person of rationality 100.
_MOST_CELLS_PER_SIDE = 128  # More would fill the memory.


@dataclass(frozen=True)
class Fit:
    """Three looks at the demonstrations, each a p-value: small where they do not fit.

    Attributes:
        explained: How often demonstrations drawn from the posterior would lie further
            from what each sample wants than the given ones do (posterior predictive
            check, Gelman, Meng and Stern 1996).
        foretold: For each demonstration after the first, how often an answer drawn from
            the posterior before it would have been further from the robot's guess.
    """

    explained: float
    foretold: tuple[float, ...]

    @property
    def p_value(self) -> float:
        """The smallest of the three, times three (Bonferroni), at most 1.

        Of what was foretold, all together (Fisher) and the worst by itself are looked
        at: a bias shows in the one, a blunder in the other.
        """
        looks = [self.explained]
        if self.foretold:
            looks += [
                fisher_p_value(self.foretold),
                min(1.0, len(self.foretold) * min(self.foretold)),
            ]
        return min(1.0, len(looks) * min(looks))


def fisher_p_value(p_values: Sequence[float]) -> float:
    """Combine independent p-values by the sum of their logarithms (Fisher 1925)."""
    half = -sum(math.log(max(p, 1e-300)) for p in p_values)
    term, total = 1.0, 1.0
    for i in range(1, len(p_values)):
        term *= half / i
        total += term
    return min(1.0, math.exp(-half) * total)


def explained_p_value(
    demos: Sequence[Demonstration],
    posterior: Posterior,
    widths: Array,
    config: PlacementConfig,
    *,
    rng: np.random.Generator,
) -> float:
    """Return `Fit.explained`: compare sums of squared distances, sample by sample."""
    given = drawn = 0.0
    for demo in demos:
        wanted = best_placements(posterior.weights, demo.layout[None], widths)[0]
        answers = draw_answers(posterior, demo.layout, wanted, widths, config, rng=rng)
        given = given + np.square(demo.placement - wanted).sum(axis=1)
        drawn = drawn + np.square(answers - wanted).sum(axis=1)
    return _share(np.asarray(drawn >= given))


def foretold_p_value(
    demo: Demonstration,
    before: Posterior,
    widths: Array,
    config: PlacementConfig,
    *,
    rng: np.random.Generator,
) -> float:
    """Return how unlikely a demonstration was by the posterior before it."""
    wanted = best_placements(before.weights, demo.layout[None], widths)[0]
    guess = best_placements(before.guessed_weights[None], demo.layout[None], widths)[0]
    surprise = np.linalg.norm(demo.placement - guess[0])
    outcomes = [
        np.linalg.norm(
            draw_answers(before, demo.layout, wanted, widths, config, rng=rng) - guess,
            axis=1,
        )
        >= surprise
        for _ in range(_NUM_ANSWERS)
    ]
    return _share(np.concatenate(outcomes))


def draw_answers(
    posterior: Posterior,
    layout: Array,
    wanted: Array,
    widths: Array,
    config: PlacementConfig,
    *,
    rng: np.random.Generator,
) -> Array:
    """Draw what a person would answer under each sample.

    Args:
        posterior: N samples.
        layout: Object centers, shape (K, 2), in table units.
        wanted: Best placement of each sample, shape (N, 2).
        widths: Width of each RBF, shape (D,).
        config: The model of the person.
        rng: Source of the answers.

    Returns:
        Placements, shape (N, 2), in table units.
    """
    scales = posterior.scales
    if posterior.likeliest_model(config.likelihood) == "placement":
        stds = config.noise.noise_std if scales is None else scales[:, None]
        return np.clip(wanted + stds * rng.standard_normal(wanted.shape), 0.0, 1.0)
    betas = config.boltzmann.beta if scales is None else scales[:, None]
    size = _enough_cells(float(np.max(betas)))
    grid = cell_centers(size)
    rewards = posterior.weights @ rbf_features(grid, all_centers(layout), widths).T
    exponents = betas * rewards
    chances = np.exp(exponents - exponents.max(axis=1, keepdims=True)).cumsum(axis=1)
    draws = rng.random(len(chances)) * chances[:, -1]
    cells = (chances < draws[:, None]).sum(axis=1)
    offsets = (rng.random((len(cells), 2)) - 0.5) / size
    return grid[np.minimum(cells, len(grid) - 1)] + offsets


def _enough_cells(beta: float) -> int:
    """Return so many cells along a side that answers spread over several of them."""
    size = math.ceil(_CELLS_PER_SIDE * math.sqrt(beta / 100.0))
    return min(max(size, _CELLS_PER_SIDE), _MOST_CELLS_PER_SIDE)


def _share(outcomes: Array) -> float:
    """Return a share that is never 0, as that of simulations cannot be."""
    return float((1 + np.count_nonzero(outcomes)) / (1 + len(outcomes)))
