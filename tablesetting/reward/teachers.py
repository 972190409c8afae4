"""Simulated people who show where an item goes, each erring in a way of their own.

A likelihood assumes a person of one kind, with a reward of the class; these are to find
out how much of what is learned survives where people are not like that.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tablesetting.irl.arrays import Array
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import all_centers, rbf_features

_MIN_CELLS = 16  # Along a side.
_MAX_BETA = 1e4  # Placements spread by some 2 mm; the grid grows with it.
_BATCH = 64  # Proposals drawn at a time.


class Teacher(Protocol):
    """Someone who answers a layout with a placement."""

    @property
    def wants_best(self) -> bool:
        """Whether the item is wanted where the true reward is greatest."""
        ...

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer one layout.

        Args:
            weights: Weights of the true reward, shape (K + 9,), objects first.
            layout: Object centers, shape (K, 2), in table units.
            widths: Width of each RBF, shape (K + 9,), in squared table units.
            rng: Source of the errors.

        Returns:
            The placement, shape (2,), in table units; always on the unit square.
        """
        ...

    def wishes(self, weights: Array, layouts: Array, widths: Array) -> Array:
        """Return where the item is truly wanted, whatever answers are like.

        Args:
            weights: Weights of the true reward, shape (K + 9,), objects first.
            layouts: Object centers, shape (L, K, 2), in table units.
            widths: Width of each RBF, shape (K + 9,), in squared table units.

        Returns:
            Placements, shape (L, 2), in table units; always on the unit square.
        """
        ...


class _WantsBest:
    """Someone who wants the item where the true reward is greatest."""

    wants_best: ClassVar[bool] = True

    def wishes(self, weights: Array, layouts: Array, widths: Array) -> Array:
        """Answer as `Teacher.wishes`."""
        return _on_square(best_placements(weights[None], layouts, widths)[:, 0])


@dataclass(frozen=True)
class ExactTeacher(_WantsBest):
    """Puts the item where the true reward is greatest; draws nothing."""

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer as `Teacher.show`: the best placement on the square."""
        return _best(weights, layout, widths)


@dataclass(frozen=True)
class BoltzmannTeacher(_WantsBest):
    r"""Draws from :math:`e^{\beta R(x)} / Z` on the unit square, without error.

    The model of `likelihood.BoltzmannLikelihood` (Ramachandran and Amir 2007). About an
    optimum of the one weight w, with the width s, the standard deviation is
    :math:`\sqrt{s / (2 \beta w)}`: 0.039 for the spoon, at the default.
    """

    beta: float = 100.0
    """How rational the person is."""

    def __post_init__(self) -> None:
        if not 0.0 < self.beta <= _MAX_BETA:
            raise ValueError(
                f"`beta` must be positive and at most {_MAX_BETA:g}, beyond which "
                f"`ExactTeacher` is as good; got {self.beta}"
            )

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer as `Teacher.show`, by rejection under a bound for each cell of a grid.

        A cell is drawn by its bound and a point evenly in it, then kept with the
        probability that the density has of the bound there (von Neumann 1951).
        """
        centers = all_centers(layout)
        bounds = _cell_bounds(self.beta * weights, centers, widths)
        chances = np.exp(bounds - bounds.max()).ravel()
        chances /= chances.sum()
        while True:
            cells = rng.choice(len(chances), size=_BATCH, p=chances)
            corners = np.stack(np.divmod(cells, len(bounds))[::-1], axis=-1)
            points = (corners + rng.random((_BATCH, 2))) / len(bounds)
            log_densities = self.beta * (
                rbf_features(points, centers, widths) @ weights
            )
            log_kept = log_densities - bounds.ravel()[cells]
            kept = np.flatnonzero(-rng.standard_exponential(_BATCH) <= log_kept)
            if kept.size:
                return points[kept[0]]


@dataclass(frozen=True)
class NoisyTeacher(_WantsBest):
    """Aims at the best placement with an unsteady hand: Gaussian, clipped."""

    noise_std: float = 0.02
    """Standard deviation along each side, in table units; the square is 0.50 m wide, so
    the default is 1 cm."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise_std < math.inf:
            raise ValueError(
                f"`noise_std` must be finite and 0 or more; got {self.noise_std}"
            )

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer as `Teacher.show`: the best placement, and noise."""
        best = _best(weights, layout, widths)
        return _on_square(best + self.noise_std * rng.standard_normal(2))


@dataclass(frozen=True)
class BlunderingTeacher(_WantsBest):
    """Is exact, but now and then puts the item just anywhere.

    Psychophysics calls it a lapse (Wichmann and Hill 2001). Learning takes none into
    account: a blunder is as unlikely as its reward is low.
    """

    probability: float = 0.1
    """Of a placement drawn evenly on the square."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.probability <= 1.0:
            raise ValueError(
                f"`probability` must be from 0 to 1; got {self.probability}"
            )

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer as `Teacher.show`; draws as much whether it blunders or not."""
        chance, anywhere = rng.random(), rng.random(2)
        if chance < self.probability:
            return anywhere
        return _best(weights, layout, widths)


@dataclass(frozen=True)
class BiasedTeacher(_WantsBest):
    """Misses the best placement by the same offset each time, clipped.

    Like someone who stands at one side and reads the table askew; draws nothing.
    """

    bias: tuple[float, float] = (0.05, 0.0)
    """What is added to the best placement, along x and y, in table units."""

    def __post_init__(self) -> None:
        _check_pair("bias", self.bias)

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer as `Teacher.show`: the best placement, and the bias."""
        return _on_square(_best(weights, layout, widths) + np.array(self.bias))


@dataclass(frozen=True)
class OffsetTeacher:
    r"""Wants the item beside an object: the spoon to the right of the bowl.

    The object is the one of the largest weight, the first of several; the other weights
    do not count. Draws nothing. Where the offset d leads off the table, each coordinate
    is clipped.

    With d = 0 the object's RBF alone has this wish. With any other, no reward of the
    class has it in every layout: RBFs are isotropic, so that to have an object's left
    and right differ takes the RBFs of others. Were :math:`c + d` the optimum for all
    object centers c that leave it inside the square, then the gradients there cancel.
    Those of other objects change as these move, so their weights are 0. What the
    object adds, :math:`-2 w d e^{-\lVert d \rVert^2 / \sigma^2} / \sigma^2`, is the same
    for all c, so the table's RBFs have a constant gradient. They are analytic and fade
    far away, so that it is 0; then so is w, and the reward says nothing of the object.
    (Bobu et al. 2020 treat preferences outside the hypothesis space.)
    """

    wants_best: ClassVar[bool] = False

    offset: tuple[float, float] = (0.15, 0.0)
    """From the object's center to the placement, along x and y, in table units."""

    def __post_init__(self) -> None:
        _check_pair("offset", self.offset)

    def show(
        self,
        weights: Array,
        layout: Array,
        widths: Array,
        *,
        rng: np.random.Generator,
    ) -> Array:
        """Answer as `Teacher.show`: beside the object of the largest weight."""
        return self.wishes(weights, layout[None], widths)[0]

    def wishes(self, weights: Array, layouts: Array, widths: Array) -> Array:
        """Answer as `Teacher.wishes`: beside the object of the largest weight."""
        favourite = layouts[:, np.argmax(weights[: layouts.shape[1]])]
        return _on_square(favourite + np.array(self.offset))


def _best(weights: Array, layout: Array, widths: Array) -> Array:
    """Find where the reward is greatest on the square, shape (2,)."""
    return _on_square(best_placements(weights[None], layout[None], widths)[0, 0])


def _on_square(placement: Array) -> Array:
    """Clip each coordinate to the unit square."""
    return np.clip(placement, 0.0, 1.0)


def _cell_bounds(weights: Array, centers: Array, widths: Array) -> Array:
    r"""Bound a reward from above in every cell of a grid on the unit square.

    No second derivative is below :math:`-M = -\sum_i 2 |w_i| / \sigma_i^2`, so that
    :math:`R(x) + M \lVert x - m \rVert^2 / 2` is convex: in a cell of the midpoint m and
    the side h, R exceeds its maximum over the corners by :math:`M h^2 / 4` at most. The
    side is chosen so that this is 1/4 or less.

    Returns:
        Bounds, shape (n, n); rows from y = 0 up, columns from x = 0.
    """
    curvature = 2.0 * (np.abs(weights) / widths).sum()
    size = max(math.ceil(math.sqrt(curvature)), _MIN_CELLS)
    ticks = np.linspace(0.0, 1.0, size + 1)
    points = np.stack(np.meshgrid(ticks, ticks), axis=-1)
    corners = rbf_features(points, centers, widths) @ weights
    maxima = sliding_window_view(corners, (2, 2)).max(axis=(2, 3))
    return maxima + curvature / (4.0 * size**2)


def _check_pair(name: str, pair: tuple[float, float]) -> None:
    """Refuse what is not two finite numbers."""
    if len(pair) != 2 or not all(math.isfinite(value) for value in pair):
        raise ValueError(
            f"`{name}` must be two finite numbers, along x and y in table units; "
            f"got {pair}"
        )


TEACHERS: dict[str, Teacher] = {
    "exact": ExactTeacher(),
    "boltzmann": BoltzmannTeacher(),
    "noisy": NoisyTeacher(),
    "blundering": BlunderingTeacher(),
    "biased": BiasedTeacher(),
    "offset": OffsetTeacher(),
}
"""Each kind of person by name, with the default parameters."""
