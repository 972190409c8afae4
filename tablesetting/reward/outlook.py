"""What a posterior says of layouts that could be asked about."""

from functools import cached_property

import numpy as np
from scipy.spatial.distance import cdist

from tablesetting.irl.arrays import Array, Indices, row_blocks
from tablesetting.irl.outlook import Answers
from tablesetting.irl.posterior import Posterior
from tablesetting.reward.config import PlacementConfig
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import all_centers, rbf_features
from tablesetting.reward.square import cell_centers

_NUM_COMPARED = 100  # Samples that strategies compare with each other.
_ANSWERS_PER_SIDE = 16  # Cells of the square, for a demonstrator who chooses freely.
_CLASSES_PER_SIDE = 10
_LEAST_STD = 0.03  # Of answers, in table units: less would not overlap.


class PlacementOutlook:
    """Implements `irl.outlook.Outlook`: losses are distances in table units."""

    def __init__(
        self,
        layouts: Array,
        deployment: Array,
        posterior: Posterior,
        widths: Array,
        config: PlacementConfig,
    ):
        """Look at candidate layouts, shape (Q, K, 2), and deployment's, (T, K, 2)."""
        self._layouts = layouts
        self._deployment = deployment
        self._posterior = posterior
        self._widths = widths
        self._config = config
        num_samples = len(posterior.weights)
        num_compared = min(num_samples, _NUM_COMPARED)
        self._compared = np.arange(num_compared) * num_samples // num_compared
        self._weights = posterior.weights[self._compared]

    @property
    def num_queries(self) -> int:
        """Number of candidates, Q."""
        return len(self._layouts)

    @property
    def ess(self) -> float:
        """Independent draws that the N samples are worth."""
        return self._posterior.kept_ess

    @cached_property
    def losses(self) -> Array:
        """Distance of the guess's placement from each sample's, shape (Q, N)."""
        return placement_losses(self._layouts, self._posterior, self._widths)

    @cached_property
    def _placements(self) -> Array:
        """Best placement of each sample in each candidate, shape (Q, M, 2)."""
        return best_placements(self._weights, self._layouts, self._widths)

    @cached_property
    def _deployed_placements(self) -> Array:
        """The same in the layouts of the deployment, the guess's first, (T, M + 1, 2)."""
        weights = np.vstack([self._posterior.guessed_weights, self._weights])
        return best_placements(weights, self._deployment, self._widths)

    def answers(self, query: int) -> Answers:
        """Return the placements that a person could answer with.

        For a noisily rational person these are the cells of a grid; for one who means
        the best placement, that of each sample, hit or missed by a Gaussian error.
        """
        if self._posterior.likeliest_model(self._config.likelihood) == "placement":
            squared = self.distances(query) ** 2
            std = max(self._scale(self._config.noise.noise_std), _LEAST_STD)
            density = np.exp(-0.5 * squared / std**2) / (2.0 * np.pi * std**2)
            cell = 1.0 / _ANSWERS_PER_SIDE**2
            return Answers(density * cell, np.full(len(squared), 1.0 / len(squared)))
        grid = cell_centers(_ANSWERS_PER_SIDE)
        beta = self._scale(self._config.boltzmann.beta)
        chances = (beta * self._weights) @ self._features(query, grid).T
        chances -= chances.max(axis=1, keepdims=True)
        np.exp(chances, out=chances)
        chances /= chances.sum(axis=1, keepdims=True)
        return Answers(chances, chances.mean(axis=0))

    def classes(self, query: int) -> Indices:
        """Return the cell of the square that each best placement is in, shape (M,)."""
        cells = (_CLASSES_PER_SIDE * self._placements[query]).astype(int)
        cells = np.minimum(cells, _CLASSES_PER_SIDE - 1)
        return cells[:, 0] + _CLASSES_PER_SIDE * cells[:, 1]

    def distances(self, query: int) -> Array:
        """Return the distances between the samples' best placements, shape (M, M)."""
        return cdist(self._placements[query], self._placements[query])

    def values(self, query: int) -> Array:
        """Return the reward by sample i of the best placement of j, shape (M, M)."""
        return self._weights @ self._features(query, self._placements[query]).T

    def best_mean_value(self, query: int) -> float:
        """Return the highest reward of one placement, on average over the samples."""
        mean = self._weights.mean(axis=0)
        layout = self._layouts[query][None]
        best = best_placements(mean[None], layout, self._widths)[0]
        return float((self._features(query, best) @ mean)[0])

    @cached_property
    def deployed_losses(self) -> Array:
        """Loss of the guess in the layouts of the deployment, shape (T, M)."""
        offsets = self._deployed_placements[:, 1:] - self._deployed_placements[:, :1]
        return np.hypot(offsets[..., 0], offsets[..., 1])

    @cached_property
    def deployed_distances(self) -> Array:
        """Distances between the samples' placements there, on average, shape (M, M)."""
        placements = self._deployed_placements[:, 1:]
        total = np.zeros((placements.shape[1],) * 2)
        for each in placements:
            total += cdist(each, each)
        return total / len(placements)

    def _scale(self, fixed: float) -> float:
        """Return the rationality or noise of the person, on average if sampled."""
        scales = self._posterior.scales
        return fixed if scales is None else float(scales.mean())

    def _features(self, query: int, points: Array) -> Array:
        """Evaluate the RBFs of a candidate at points, shape (P, 2), as (P, D)."""
        return rbf_features(points, all_centers(self._layouts[query]), self._widths)


def placement_losses(layouts: Array, posterior: Posterior, widths: Array) -> Array:
    """Measure how far the guess's placements are from those of each sample.

    Args:
        layouts: Layouts, shape (L, K, 2), in table units.
        posterior: The guess and N samples.
        widths: Width of each RBF, shape (D,), in squared table units.

    Returns:
        The loss of the paper's table task, shape (L, N), in table units.
    """
    weights = np.vstack([posterior.guessed_weights, posterior.weights])
    losses = np.empty((len(layouts), len(posterior.weights)))
    for block in row_blocks(len(layouts), len(weights)):
        placements = best_placements(weights, layouts[block], widths)
        offsets = placements[:, 1:] - placements[:, :1]
        losses[block] = np.hypot(offsets[..., 0], offsets[..., 1])
    return losses
