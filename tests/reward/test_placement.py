import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.footprint import Footprint
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import all_centers, rbf_features
from tablesetting.reward.tasks import RECEPTACLE_RADIUS, TASKS

TICKS = np.linspace(0.0, 1.0, 400)
GRID = np.stack(np.meshgrid(TICKS, TICKS), axis=-1).reshape(-1, 2)
WIDTHS = np.full(13, 0.3)
ONE_HOLE = FreeSpace(np.array([[0.4, 0.6]]), (Footprint(0.2),))
NO_OBJECTS = np.empty((1, 0, 2))


def rewards_of(points, weights, layout, widths):
    """Evaluate each reward at its own point, shape (N,)."""
    features = rbf_features(points[:, None], all_centers(layout), widths)[:, 0]
    return (features * weights).sum(axis=1)


def random_rewards(num, dim, rng):
    """Uniform rewards, sparse ones and those that only repel, to the edges."""
    weights = sample_uniform_weights(num, dim, rng=rng)
    weights[::4] *= np.abs(weights[::4]) > 0.15
    weights[1::4] = -np.abs(weights[1::4])
    return weights


def zoom(weights, layout, start):
    """Refine the best point of the dense grid by ever finer grids around it."""
    best, reach = start, TICKS[1]
    ticks = np.linspace(-1.0, 1.0, 11)
    star = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    while reach > 1e-9:
        points = np.clip(best + reach * star, 0.0, 1.0)
        values = rbf_features(points, all_centers(layout), WIDTHS) @ weights
        best, reach = points[values.argmax()], reach / 3
    return best


def dense_disc(space, center):
    """Scan a receptacle in polar coordinates, rim and center included."""
    radii = np.linspace(0.0, space.receptacle_radius, 26)[:, None]
    angles = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    offsets = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)
    return center + offsets.reshape(-1, 2)


def check_against_dense_grid(weights, layout, space, widths, tolerance=1e-9):
    """Check that every placement is free and no free grid point is better."""
    found = best_placements(weights, layout[None], widths, [space])[0]
    points = np.concatenate([GRID, *(dense_disc(space, c) for c in space.receptacles)])
    free = points[space.contains(points)]
    assert len(free)
    assert space.contains(found).all()
    on_grid = rbf_features(free, all_centers(layout), widths) @ weights.T
    gain = rewards_of(found, weights, layout, widths) - on_grid.max(axis=0)
    assert gain.min() >= -tolerance


@pytest.mark.parametrize("target", [[0.31, 0.72], [0.0, 0.4], [1.0, 1.0]])
def test_one_attractive_object_is_where_the_item_goes(target):
    weights = np.eye(13)[:1]
    layout = np.array([target, [0.5, 0.5], [0.1, 0.9], [0.9, 0.1]])
    found = best_placements(weights, layout[None], WIDTHS)
    np.testing.assert_allclose(found, [[target]], atol=1e-9)


def test_one_repulsive_object_sends_the_item_to_the_farthest_corner():
    layout = np.array([[0.4, 0.6], [0.5, 0.5], [0.1, 0.9], [0.9, 0.1]])
    found = best_placements(-np.eye(13)[:1], layout[None], WIDTHS)
    np.testing.assert_array_equal(found, [[[1.0, 0.0]]])


@pytest.mark.parametrize("seed", range(20))
def test_optimum_is_never_below_a_dense_grid_and_where_zooming_in_leads(seed):
    rng = np.random.default_rng(seed)
    layout = rng.random((4, 2))
    weights = random_rewards(100, 13, rng)
    found = best_placements(weights, layout[None], WIDTHS)[0]
    on_grid = rbf_features(GRID, all_centers(layout), WIDTHS) @ weights.T
    gain = rewards_of(found, weights, layout, WIDTHS) - on_grid.max(axis=0)
    assert gain.min() >= -1e-12
    num_unique = 0
    some = slice(None, None, 7)  # Enough to see a rival.
    for point, weight, values in zip(found, weights, on_grid.T.copy(), strict=True):
        start = GRID[values.argmax()]
        elsewhere = np.abs(GRID[some] - start).max(axis=1) > 0.05
        if values[some][elsewhere].max() < values.max() - 1e-3:
            num_unique += 1
            refined = zoom(weight, layout, start)
            np.testing.assert_allclose(point, refined, atol=1e-6)
    assert num_unique > 50


@settings(deadline=None)
@given(st.integers(0, 2**32), st.integers(-6, 0))
def test_scale_of_the_reward_does_not_matter(seed, exponent):
    rng = np.random.default_rng(seed)
    weights = sample_uniform_weights(5, 13, rng=rng)
    layout = rng.random((1, 4, 2))
    scaled = best_placements(10.0**exponent * weights, layout, WIDTHS)[0]
    expected = best_placements(weights, layout, WIDTHS)[0]
    worth = [rewards_of(p, weights, layout[0], WIDTHS) for p in (scaled, expected)]
    np.testing.assert_allclose(worth[0], worth[1], atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_narrower_rbfs_hide_no_optimum(seed):
    rng = np.random.default_rng(seed)
    layout = rng.random((4, 2))
    weights = random_rewards(40, 13, rng)
    everywhere = FreeSpace(np.empty((0, 2)), ())
    check_against_dense_grid(weights, layout, everywhere, np.full(13, 0.1))


def test_layouts_and_rewards_do_not_influence_each_other():
    rng = np.random.default_rng(0)
    layouts = rng.random((3, 4, 2))
    weights = sample_uniform_weights(6, 13, rng=rng)
    together = best_placements(weights, layouts, WIDTHS)
    assert together.shape == (3, 6, 2)
    for row, layout in zip(together, layouts, strict=True):
        for point, weight in zip(row, weights, strict=True):
            alone = best_placements(weight[None], layout[None], WIDTHS)[0, 0]
            np.testing.assert_allclose(alone, point, atol=1e-9)


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("kind", ["valid", "overlapping"])
@pytest.mark.parametrize("seed", range(4))
def test_restricted_optimum_is_free_and_never_below_a_dense_grid(name, kind, seed):
    rng = np.random.default_rng(seed)
    task = TASKS[name]
    layouts = LayoutSpace.of_task(task, are_points=False)
    layout = rng.random((len(task.objects), 2))
    if kind == "valid":
        layout = layouts.sample(1, rng=rng)[0]
    weights = random_rewards(40, len(task.objects) + 9, rng)
    weights[0] = task.true_weights
    space = layouts.free_space(layout, task.receptacles)
    check_against_dense_grid(weights, layout, space, np.full(weights.shape[1], 0.3))


def stationary_at(point, layout, widths, weights):
    """Change weights so that gradient and Hessian vanish at a point."""
    offsets = point - all_centers(layout)
    x, y = offsets.T
    flat = 0.5 * widths
    terms = np.array([x, y, x * x - flat, y * y - flat, x * y])
    terms *= np.exp(-np.square(offsets).sum(axis=1) / widths)
    return weights - np.linalg.pinv(terms) @ (terms @ weights)


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 2**32),
    st.sampled_from([0.002, RECEPTACLE_RADIUS, 0.05]),
    st.sampled_from([0.05, 0.3]),
    st.booleans(),
)
def test_no_point_of_a_receptacle_or_beside_it_is_better(seed, radius, width, at_edge):
    rng = np.random.default_rng(seed)
    layout = rng.random((4, 2))
    if at_edge:
        layout[0, seed % 2] = radius * rng.random()
    widths, weights = np.full(13, width), random_rewards(20, 13, rng)
    for row in weights[::2]:
        point = layout[0] + 0.5 * radius * rng.uniform(-1.0, 1.0, 2)
        row[:] = stationary_at(point, layout, widths, row)
    for size in (0.2, 2.0):  # Beside the receptacle much is free, or nothing.
        space = FreeSpace(layout[:2], (Footprint(size),) * 2, layout[:1], radius)
        # So flat a reward may have optima that neither grid nor rim samples show.
        check_against_dense_grid(weights, layout, space, widths, tolerance=1e-5)


def test_a_peak_outside_a_receptacle_moves_to_the_nearest_point_of_its_rim():
    weights = np.eye(9)[4:5]
    full = FreeSpace(
        np.array([[0.5, 0.5]]), (Footprint(0.8),), np.array([[0.2, 0.1]]), 0.05
    )
    found = best_placements(weights, NO_OBJECTS, np.full(9, 0.3), [full])[0, 0]
    np.testing.assert_allclose(found, [0.23, 0.14], atol=1e-9)


def test_the_best_of_several_receptacles_is_taken():
    weights = np.array([[0.2, 0.9, 0.4, *np.zeros(9)]])
    layout = np.array([[0.1, 0.1], [0.5, 0.9], [0.9, 0.1]])
    widths = np.full(12, 0.05)
    full = FreeSpace(np.array([[0.5, 0.5]]), (Footprint(0.8),), layout[[0, 2]], 0.02)
    found = best_placements(weights, layout[None], widths, [full])[0, 0]
    np.testing.assert_allclose(found, layout[2], atol=1e-3)


@settings(deadline=None)
@given(st.integers(0, 2**32))
def test_an_optimum_that_is_free_stays_where_it_is(seed):
    rng = np.random.default_rng(seed)
    layout = rng.random((1, 4, 2))
    weights = sample_uniform_weights(20, 13, rng=rng)
    anywhere = best_placements(weights, layout, WIDTHS)[0]
    restricted = best_placements(weights, layout, WIDTHS, [ONE_HOLE])[0]
    is_free = ONE_HOLE.contains(anywhere)
    np.testing.assert_array_equal(restricted[is_free], anywhere[is_free])
    assert ONE_HOLE.contains(restricted).all()


def test_a_peak_under_an_obstacle_moves_to_the_nearest_point_of_the_outline():
    # One RBF at the table's centre, whose reward falls with the distance from it.
    weights = np.eye(9)[4:5]
    hole = FreeSpace(np.array([[0.4, 0.55]]), (Footprint(0.2),))
    found = best_placements(weights, NO_OBJECTS, np.full(9, 0.3), [hole])[0, 0]
    direction = np.array([0.1, -0.05]) / np.hypot(0.1, 0.05)
    np.testing.assert_allclose(found, [0.4, 0.55] + 0.2 * direction, atol=1e-9)


def test_a_peak_under_two_obstacles_moves_to_the_gusset_between_them():
    weights = np.eye(9)[4:5]
    centers = np.array([[0.35, 0.51], [0.65, 0.51]])
    pair = FreeSpace(centers, (Footprint(0.25), Footprint(0.25)))
    found = best_placements(weights, NO_OBJECTS, np.full(9, 0.3), [pair])[0, 0]
    np.testing.assert_allclose(found, [0.5, 0.31], atol=1e-9)


def test_free_spaces_belong_to_their_layouts():
    rng = np.random.default_rng(0)
    layouts = rng.random((2, 4, 2))
    weights = sample_uniform_weights(30, 13, rng=rng)
    nothing_in_the_way = FreeSpace(np.empty((0, 2)), ())
    found = best_placements(weights, layouts, WIDTHS, [nothing_in_the_way, ONE_HOLE])
    free = best_placements(weights, layouts, WIDTHS)
    np.testing.assert_array_equal(found[0], free[0])
    assert ONE_HOLE.contains(found[1]).all()
    assert not ONE_HOLE.contains(free[1]).all()


def test_no_placement_where_nothing_is_free():
    full = FreeSpace(np.array([[0.5, 0.5]]), (Footprint(0.8),))
    weights = sample_uniform_weights(5, 13, rng=np.random.default_rng(0))
    found = best_placements(weights, np.full((1, 4, 2), 0.5), WIDTHS, [full])
    assert found.shape == (1, 5, 2)
    assert np.isnan(found).all()
