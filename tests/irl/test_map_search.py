import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tablesetting.irl.arrays import normalize_l1
from tablesetting.irl.map_search import climb_to_map, find_map, maximize_on_ball
from tablesetting.irl.sampler import sample_uniform_weights

NUM_STEPS = 60


def hill(top, scale=50.0):
    """Return a log density that falls with the squared distance, and its gradient."""
    top = np.asarray(top)

    def log_density(weights):
        return -scale * np.square(weights - top).sum(axis=1)

    return log_density, lambda weights: -2.0 * scale * (weights - top)


@pytest.mark.parametrize("mode", [(0.6, -0.3, 0.1), (1.0, 0.0, 0.0), (0.0, -0.5, 0.5)])
def test_the_search_climbs_from_a_good_sample_to_the_mode(mode):
    """On a face of the L1 sphere, at its vertex and on an edge."""
    rng = np.random.default_rng(0)
    log_density, _ = hill(mode)
    for noise in rng.normal(0.0, 0.1, (10, 3)):
        start = normalize_l1(mode + noise)
        found = climb_to_map(log_density, start, 200, rng=rng)
        assert np.abs(found).sum() == pytest.approx(1.0)
        np.testing.assert_allclose(found, mode, atol=1e-3)


@pytest.mark.parametrize(
    ("top", "expected"),
    [
        ((1.2, -0.6, 0.0), (0.8, -0.2, 0.0)),  # Both shrink by 0.4.
        ((1.2, -0.1, 0.1), (1.0, 0.0, 0.0)),  # All but one shrink to nothing.
        ((0.1, -0.3, 0.2), (0.1, -0.3, 0.2)),  # It is inside.
    ],
)
def test_nearest_point_of_the_ball_by_hand(top, expected):
    for start in np.vstack([np.eye(3), -np.eye(3)]):
        found = maximize_on_ball(*hill(top), start, NUM_STEPS)
        np.testing.assert_allclose(found, expected, atol=1e-4)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_concave_maximum_on_the_sphere_does_not_depend_on_the_start(seed):
    rng = np.random.default_rng(seed)
    top = 1.5 * sample_uniform_weights(1, 6, rng=rng)[0]  # Outside the ball.
    log_density, gradient = hill(top)
    starts = sample_uniform_weights(4, 6, rng=rng)
    found = np.array(
        [
            find_map(log_density, start, NUM_STEPS, gradient=gradient, rng=rng)
            for start in starts
        ]
    )
    np.testing.assert_allclose(np.abs(found).sum(axis=1), 1.0)
    np.testing.assert_allclose(found, found[:1].repeat(4, axis=0), atol=1e-4)
    anywhere = sample_uniform_weights(1000, 6, rng=rng)
    assert log_density(found).min() >= log_density(anywhere).max()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("norm", [0.3, 0.95])
def test_where_the_maximum_is_inside_the_search_climbs_on_from_it(norm, seed):
    """Wherever it began; a square falls alike on all sides of the nearest point."""
    log_density, gradient = hill(norm * np.array([0.5, 0.3, -0.2]))
    rng = np.random.default_rng(seed)
    start = sample_uniform_weights(1, 3, rng=rng)[0]
    found = find_map(log_density, start, NUM_STEPS, gradient=gradient, rng=rng)
    # All three move by a third of what is missing.
    expected = norm * np.array([0.5, 0.3, -0.2]) + (1 - norm) / 3 * np.array([1, 1, -1])
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_a_maximum_at_zero_leaves_the_climb():
    log_density, gradient = hill((0.0, 0.0, 0.0))
    start = np.array([1.0, 0.0, 0.0])
    rng = np.random.default_rng(0)
    found = find_map(log_density, start, NUM_STEPS, gradient=gradient, rng=rng)
    np.testing.assert_allclose(np.abs(found), 1 / 3, atol=1e-3)


def test_a_search_of_the_ball_that_was_cut_short_climbs_on():
    log_density, gradient = hill((1.1, -0.7, 0.3), scale=1e4)
    start = np.array([0.0, 0.0, 1.0])
    rng = np.random.default_rng(0)
    short = maximize_on_ball(log_density, gradient, start, 1)
    found = find_map(log_density, start, 1, gradient=gradient, rng=rng)
    assert not np.allclose(found, (0.7, -0.3, 0.0), atol=1e-3)
    assert log_density(found[None]) > log_density(normalize_l1(short)[None])


def test_a_search_that_fails_keeps_the_start():
    """As it does where the gradient points away from the maximum."""
    log_density, gradient = hill((2.0, 0.0, 0.0))
    start = np.array([0.0, 1.0, 0.0])
    found = find_map(
        log_density,
        start,
        NUM_STEPS,
        gradient=lambda weights: -gradient(weights),
        rng=np.random.default_rng(0),
    )
    assert log_density(found[None]) >= log_density(start[None])
