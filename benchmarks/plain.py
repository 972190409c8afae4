"""The method of the paper in plain numpy: what the package is measured against.

Best placements by gradient ascent from random restarts, the posterior by a likelihood
that numpy evaluates in every step of `irl.random_walk.walk`. The paper's item may stand
anywhere; where it must fit, an ascent would end at the first object in its way, so that
scans take its place.
"""

from collections.abc import Sequence

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.likelihood import BoltzmannConfig, Demonstration
from tablesetting.reward.rbf import all_centers, rbf_features

_NUM_RESTARTS = 10
_NUM_STEPS = 50
_STEP_SIZE = 0.05
_BLOCK_ELEMENTS = 2**15  # Features evaluated at once: what a processor's cache holds.
_SCANS = ((0.5, 25), (0.02, 5))  # Half width, and steps each way, of each scan.


def best_placements(
    weights: Array, layouts: Array, widths: Array, *, rng: np.random.Generator
) -> Array:
    """Ascend to the best placement of every reward in every layout.

    Args:
        weights: Reward weights, shape (N, D).
        layouts: Object centers, shape (L, K, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.
        rng: Source of the restarts.

    Returns:
        Placements, shape (L, N, 2), in table units.
    """
    block = max(_BLOCK_ELEMENTS // (weights.size * _NUM_RESTARTS), 1)
    return np.concatenate(
        [
            _ascend(weights, layouts[first : first + block], widths, rng=rng)
            for first in range(0, len(layouts), block)
        ]
    )


def best_free_placement(
    weights: Array, layout: Array, widths: Array, space: FreeSpace
) -> Array:
    """Scan the square for the best point where the item fits, then closer around it."""
    centers, best = all_centers(layout), np.array([0.5, 0.5])
    for half_width, num_steps in _SCANS:
        offsets = half_width * np.arange(-num_steps, num_steps + 1) / num_steps
        points = best + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
        free = points[space.contains(points)]
        best = free[(rbf_features(free, centers, widths) @ weights).argmax()]
    return best


class LogLikelihood:
    """The Boltzmann likelihood; features are computed once, as the package does."""

    def __init__(
        self, demos: Sequence[Demonstration], widths: Array, config: BoltzmannConfig
    ):
        centers = all_centers(np.stack([demo.layout for demo in demos]))
        placements = np.stack([demo.placement for demo in demos])
        shown = rbf_features(placements[:, None], centers, widths)[:, 0]
        points, shares = config.nodes(widths.min())
        nodes = rbf_features(points, centers, widths)
        self._shares = shares
        self._num_demos = len(demos)
        self._shown = config.beta * shown.sum(axis=0)  # (D,)
        self._nodes = config.beta * nodes.reshape(-1, len(widths)).T  # (D, demos * G)

    def __call__(self, weights: Array) -> Array:
        """Evaluate the log likelihood of weights, shape (C, D), as shape (C,)."""
        exponents = weights @ self._nodes
        exponents = exponents.reshape(len(weights), self._num_demos, -1)
        peaks = exponents.max(axis=2)
        masses = np.exp(exponents - peaks[..., None]) @ self._shares
        return weights @ self._shown - (peaks + np.log(masses)).sum(axis=1)


def _ascend(
    weights: Array, layouts: Array, widths: Array, *, rng: np.random.Generator
) -> Array:
    """Ascend from random points, all at once, and keep the best end of each reward."""
    centers = all_centers(layouts)
    each = np.repeat(weights, _NUM_RESTARTS, axis=0)  # (S, D): a reward for each climb.
    slopes = 2.0 * each / widths
    points = rng.random((len(layouts), len(each), 2))
    for _ in range(_NUM_STEPS):
        terms = slopes * rbf_features(points, centers, widths)  # (L, S, D)
        gradients = terms @ centers - terms.sum(axis=2, keepdims=True) * points
        points = np.clip(points + _STEP_SIZE * gradients, 0.0, 1.0)
    rewards = (each * rbf_features(points, centers, widths)).sum(axis=2)
    ends = points.reshape(len(layouts), len(weights), _NUM_RESTARTS, 2)
    best = rewards.reshape(ends.shape[:3]).argmax(axis=2)
    return np.take_along_axis(ends, best[..., None, None], axis=2)[:, :, 0]
