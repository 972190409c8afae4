import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.footprint import Footprint
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.likelihood import (
    BoltzmannConfig,
    BoltzmannLikelihood,
    Demonstration,
)
from tablesetting.reward.problem import DEFAULT, PlacementProblem
from tablesetting.reward.rbf import TABLE_CENTERS
from tablesetting.reward.tasks import SPOON, TASKS, VASE

WIDTHS = np.full(13, 0.3)
CELLS = BoltzmannConfig(resolution=8)
LATTICE = BoltzmannConfig(quadrature="lattice", resolution=10)
EVERYWHERE = FreeSpace(np.empty((0, 2)), ())
HALF = FreeSpace(np.array([[-1.0, 0.5]]), (Footprint(1.5, half_length=5.0),))
HOLE = FreeSpace(np.array([[0.3, 0.6]]), (Footprint(0.25),))


def random_demos(num_demos, rng, num_objects=4):
    return [
        Demonstration(rng.random((num_objects, 2)), rng.random(2))
        for _ in range(num_demos)
    ]


def plain_log_likelihood(weights, demos, spaces, config):
    """Sum over demonstrations and nodes one at a time."""

    def reward(point, layout):
        centers = [*layout, *TABLE_CENTERS]
        squared = [np.sum((point - center) ** 2) for center in centers]
        return sum(
            w * math.exp(-d / 0.3) for w, d in zip(weights, squared, strict=True)
        )

    total = 0.0
    for demo, space in zip(demos, spaces, strict=True):
        normaliser = sum(
            area * math.exp(config.beta * reward(point, demo.layout))
            for point, area in zip(*config.nodes(space), strict=True)
        )
        total += config.beta * reward(demo.placement, demo.layout)
        total -= math.log(normaliser)
    return total


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"beta": 0.0}, "`beta` must be positive; got 0.0"),
        ({"beta": math.nan}, "`beta` must be positive; got nan"),
        ({"resolution": 1}, "`resolution` must be at least 2; got 1"),
    ],
)
def test_settings_without_meaning_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        BoltzmannConfig(**setting)


def test_lattice_includes_the_edges_and_weighs_all_points_alike():
    points, weights = LATTICE.nodes(HOLE)
    assert points.shape == (100, 2)
    np.testing.assert_allclose(np.unique(points), np.arange(10) / 9)
    np.testing.assert_array_equal(weights, 0.01)


@pytest.mark.parametrize(
    ("config", "space", "density"),
    [(CELLS, EVERYWHERE, 1.0), (CELLS, HALF, 2.0), (LATTICE, HALF, 1.0)],
)
def test_without_preference_every_free_placement_is_equally_likely(
    config, space, density
):
    demos = random_demos(3, np.random.default_rng(0))
    likelihood = BoltzmannLikelihood(demos, [space] * 3, WIDTHS, config)
    expected = 3 * math.log(density)
    np.testing.assert_allclose(likelihood(np.zeros((2, 13))), expected, atol=1e-12)


def test_two_nodes_by_hand():
    # Four lattice points, the corners; a reward that is 1 at one and e^-r^2 elsewhere.
    config = BoltzmannConfig(beta=2.0, quadrature="lattice", resolution=2)
    demo = Demonstration(np.array([[0.0, 0.0]]), np.array([0.0, 0.0]))
    weights = np.eye(10)[:1]
    likelihood = BoltzmannLikelihood([demo], [EVERYWHERE], np.ones(10), config)
    corners = [1.0, math.exp(-1.0), math.exp(-1.0), math.exp(-2.0)]
    normaliser = sum(math.exp(2.0 * reward) for reward in corners) / 4
    np.testing.assert_allclose(likelihood(weights), 2.0 - math.log(normaliser))


@pytest.mark.parametrize("config", [CELLS, LATTICE], ids=["cells", "lattice"])
@pytest.mark.parametrize("space", [EVERYWHERE, HOLE], ids=["everywhere", "hole"])
def test_log_likelihood_equals_plain_sums(config, space):
    rng = np.random.default_rng(0)
    demos = random_demos(3, rng)
    spaces = [space, EVERYWHERE, HALF]  # Different numbers of free cells.
    weights = sample_uniform_weights(4, 13, rng=rng)
    found = BoltzmannLikelihood(demos, spaces, WIDTHS, config)(weights)
    expected = [plain_log_likelihood(w, demos, spaces, config) for w in weights]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@settings(deadline=None)
@given(st.integers(0, 2**32))
def test_order_of_demonstrations_and_of_objects_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    demos = random_demos(3, rng)
    spaces = [EVERYWHERE, HOLE, HALF]
    weights = sample_uniform_weights(4, 13, rng=rng)
    expected = BoltzmannLikelihood(demos, spaces, WIDTHS, CELLS)(weights)

    backwards = BoltzmannLikelihood(demos[::-1], spaces[::-1], WIDTHS, CELLS)
    np.testing.assert_allclose(backwards(weights), expected)

    order = rng.permutation(4)
    renamed = [Demonstration(demo.layout[order], demo.placement) for demo in demos]
    weights[:, :4] = weights[:, order]
    permuted = BoltzmannLikelihood(renamed, spaces, WIDTHS, CELLS)
    np.testing.assert_allclose(permuted(weights), expected)


def test_log_likelihood_is_concave_in_the_weights():
    rng = np.random.default_rng(0)
    likelihood = BoltzmannLikelihood(
        random_demos(3, rng), [EVERYWHERE, HOLE, HALF], WIDTHS, CELLS
    )
    left, right = sample_uniform_weights(400, 13, rng=rng).reshape(2, 200, 13)
    middle = likelihood(0.5 * (left + right))
    assert (middle >= 0.5 * (likelihood(left) + likelihood(right))).all()


@pytest.mark.parametrize("name", TASKS)
def test_halving_the_cells_changes_no_posterior_mean(name):
    task = TASKS[name]
    problem = PlacementProblem(task, DEFAULT)
    rng = np.random.default_rng(0)
    layouts = problem.space.sample(4, rng=rng)
    demos = [problem.demonstrate(layout) for layout in layouts]
    spaces = problem.free_spaces(layouts)
    weights = problem.infer(demos, None, rng=rng).weights
    log_ratio = np.zeros(len(weights))
    for resolution, sign in ((48, -1.0), (96, 1.0)):
        config = BoltzmannConfig(resolution=resolution)
        likelihood = BoltzmannLikelihood(demos, spaces, problem.widths, config)
        log_ratio += sign * likelihood(weights)
    importance = np.exp(log_ratio - log_ratio.max())
    change = importance @ weights / importance.sum() - weights.mean(axis=0)
    assert np.abs(change).max() < 1e-3


def test_truth_is_more_likely_than_other_rewards_after_many_demonstrations():
    for task in (VASE, SPOON):
        problem = PlacementProblem(task, DEFAULT)
        rng = np.random.default_rng(0)
        layouts = problem.space.sample(10, rng=rng)
        demos = [problem.demonstrate(layout) for layout in layouts]
        likelihood = BoltzmannLikelihood(
            demos, problem.free_spaces(layouts), problem.widths, CELLS
        )
        others = sample_uniform_weights(500, len(problem.widths), rng=rng)
        assert likelihood(task.true_weights[None]) > likelihood(others).max()
