import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.climb import climb
from tablesetting.reward.rbf import all_centers, reward_derivatives


def climbs(seed, num_climbs=50):
    rng = np.random.default_rng(seed)
    centers = all_centers(rng.random((num_climbs, 4, 2)))
    weights = sample_uniform_weights(num_climbs, 13, rng=rng)
    starts = rng.random((num_climbs, 2)).round(1)  # Some on the edge.
    return starts, weights, centers, np.full(13, 0.3)


def test_climb_to_a_single_peak():
    centers = np.array([[[0.62, 0.31]]])
    points, rewards = climb(
        np.array([[0.9, 0.9]]), np.array([[2.0]]), centers, np.array([0.3])
    )
    np.testing.assert_allclose(points, [[0.62, 0.31]], atol=1e-9)
    np.testing.assert_allclose(rewards, 2.0)


def test_climb_away_from_a_single_dip_ends_in_a_corner():
    centers = np.array([[[0.4, 0.7]]])
    points, _ = climb(
        np.array([[0.5, 0.6]]), np.array([[-1.0]]), centers, np.array([0.3])
    )
    np.testing.assert_allclose(points, [[1.0, 0.0]], atol=1e-12)


@settings(deadline=None)
@given(st.integers(0, 2**32))
def test_climbs_stay_on_the_square_and_end_no_lower_than_they_start(seed):
    starts, weights, centers, widths = climbs(seed)
    points, rewards = climb(starts, weights, centers, widths)
    assert ((points >= 0.0) & (points <= 1.0)).all()
    first, _, _ = reward_derivatives(starts, weights, centers, widths)
    last, _, _ = reward_derivatives(points, weights, centers, widths)
    assert (rewards >= first - 1e-14).all()
    np.testing.assert_allclose(rewards, last, atol=1e-14)


def test_nothing_leads_up_from_where_nearly_all_climbs_end():
    starts, weights, centers, widths = climbs(0, num_climbs=5000)
    points, _ = climb(starts, weights, centers, widths)
    _, gradients, hessians = reward_derivatives(points, weights, centers, widths)
    is_low, is_high = points < 1e-9, points > 1.0 - 1e-9
    upward = np.where(is_low, np.maximum(gradients, 0.0), gradients)
    upward = np.where(is_high, np.minimum(upward, 0.0), upward)
    is_stationary = np.abs(upward).max(axis=1) < 1e-7
    assert is_stationary.mean() > 0.995
    is_inside = ~(is_low | is_high).any(axis=1) & is_stationary
    assert (np.linalg.eigvalsh(hessians[is_inside]) < 1e-3).all()


def test_a_climb_goes_on_where_the_edge_cuts_its_step_off():
    """The gradient points inwards there, and the Newton step outwards."""
    rng = np.random.default_rng(0)
    widths, centers = np.full(13, 0.3), all_centers(rng.random((200_000, 4, 2)))
    weights = sample_uniform_weights(len(centers), 13, rng=rng)
    starts = np.stack([np.zeros(len(centers)), rng.random(len(centers))], axis=1)
    points, rewards = climb(starts, weights, centers, widths)
    first, _, _ = reward_derivatives(starts, weights, centers, widths)
    _, gradients, _ = reward_derivatives(points, weights, centers, widths)
    has_stayed = np.abs(points - starts).max(axis=1) < 1e-9
    leads_on = np.abs(gradients[:, 1]) > 1e-4
    is_inside = (points[:, 1] > 0.0) & (points[:, 1] < 1.0)
    assert not (has_stayed & leads_on & is_inside).any()
    assert (rewards >= first - 1e-14).all()


def test_climbs_do_not_influence_each_other():
    starts, weights, centers, widths = climbs(0)
    together, _ = climb(starts, weights, centers, widths)
    for k in range(0, len(starts), 10):
        one = slice(k, k + 1)
        alone, _ = climb(starts[one], weights[one], centers[one], widths)
        np.testing.assert_allclose(alone, together[one], atol=1e-9)
