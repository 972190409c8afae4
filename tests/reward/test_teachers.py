import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, rbf_features
from tablesetting.reward.tasks import SPOON, VASE
from tablesetting.reward.teachers import (
    TEACHERS,
    BiasedTeacher,
    BlunderingTeacher,
    BoltzmannTeacher,
    ExactTeacher,
    NoisyTeacher,
    OffsetTeacher,
    _cell_bounds,
)

WIDTHS = np.full(13, 0.3)
FIRST_LAYOUT = np.array(VASE.first_layout)
CENTRE = np.array([0.5, 0.5])  # Where the vase goes in the first layout.
SPOON_LAYOUT = np.array(
    [[0.4, 0.3], [0.8, 0.8], [0.2, 0.8], [0.8, 0.4], [0.1, 0.4], [0.6, 0.6]]
)
TRUTHS = {
    "vase": (VASE.true_weights, FIRST_LAYOUT),
    "spoon": (SPOON.true_weights, SPOON_LAYOUT),
    "corner": (np.eye(13)[4], FIRST_LAYOUT),
    "avoided": (-np.eye(13)[8], FIRST_LAYOUT),
}

by_name = pytest.mark.parametrize("teacher", TEACHERS.values(), ids=TEACHERS)


def show(teacher, truth, num_answers, seed=0):
    """Return the answers to one layout, shape (T, 2)."""
    weights, layout = truth
    widths, rng = np.full(len(weights), 0.3), np.random.default_rng(seed)
    answers = [
        teacher.show(weights, layout, widths, rng=rng) for _ in range(num_answers)
    ]
    return np.array(answers)


def cell_chances(truth, beta, size):
    """Integrate the density over the cells of a grid, shape (n, n), rows along y."""
    weights, layout = truth
    nodes, shares = np.polynomial.legendre.leggauss(8)
    ticks = ((np.arange(size)[:, None] + 0.5 * (nodes + 1.0)) / size).ravel()
    points = np.stack(np.meshgrid(ticks, ticks), axis=-1)
    squared = np.square(points[:, :, None] - [*layout, *TABLE_CENTERS]).sum(axis=-1)
    density = np.exp(beta * (np.exp(-squared / 0.3) @ weights))
    masses = density.reshape(size, 8, size, 8)
    chances = np.einsum("ajbk,j,k->ab", masses, shares, shares)
    return chances / chances.sum()


def chi_square_p_value(counts, expected):
    """Compare counts with expected ones; cells that expect under 5 go together."""
    is_rare = expected < 5.0
    assert not is_rare.all()
    counts, expected = (
        np.append(values[~is_rare], values[is_rare].sum() if is_rare.any() else [])
        for values in (counts, expected)
    )
    statistic = np.sum((counts - expected) ** 2 / expected)
    return stats.chi2.sf(statistic, len(expected) - 1)


@pytest.mark.parametrize("beta", [0.0, -1.0, 2e4, np.inf, np.nan])
def test_beta_without_meaning_is_refused(beta):
    message = f"`beta` must be positive and at most 10000, .* got {beta}"
    with pytest.raises(ValueError, match=message):
        BoltzmannTeacher(beta)


@pytest.mark.parametrize("noise_std", [-0.1, np.inf, np.nan])
def test_noise_without_meaning_is_refused(noise_std):
    message = f"`noise_std` must be finite and 0 or more; got {noise_std}"
    with pytest.raises(ValueError, match=message):
        NoisyTeacher(noise_std)


@pytest.mark.parametrize("probability", [-0.1, 1.1, np.nan])
def test_probability_without_meaning_is_refused(probability):
    message = f"`probability` must be from 0 to 1; got {probability}"
    with pytest.raises(ValueError, match=message):
        BlunderingTeacher(probability)


@pytest.mark.parametrize("pair", [(0.1,), (0.1, np.nan), (np.inf, 0.0)])
def test_pairs_without_meaning_are_refused(pair):
    with pytest.raises(ValueError, match=r"`bias` must be two finite .* got \("):
        BiasedTeacher(pair)
    with pytest.raises(ValueError, match=r"`offset` must be two finite .* got \("):
        OffsetTeacher(pair)


def test_those_who_are_as_learning_assumes_are_known():
    assert list(TEACHERS) == [
        "exact",
        "boltzmann",
        "noisy",
        "blundering",
        "biased",
        "offset",
    ]
    elsewhere = [name for name, each in TEACHERS.items() if not each.wants_best]
    assert elsewhere == ["offset"]
    fields = {f.name for each in TEACHERS.values() for f in dataclasses.fields(each)}
    assert "wants_best" not in fields


@by_name
def test_same_rng_same_answers(teacher):
    answers = show(teacher, TRUTHS["vase"], 20)
    np.testing.assert_array_equal(show(teacher, TRUTHS["vase"], 20), answers)
    draws = not isinstance(teacher, ExactTeacher | BiasedTeacher | OffsetTeacher)
    assert (show(teacher, TRUTHS["vase"], 20, seed=1) != answers).any() == draws


@settings(deadline=None)
@given(
    st.sampled_from(
        [
            *TEACHERS.values(),
            BoltzmannTeacher(0.01),
            BoltzmannTeacher(2000.0),
            NoisyTeacher(1.0),
            BlunderingTeacher(1.0),
            BiasedTeacher((-0.7, 2.0)),
            OffsetTeacher((0.6, -0.6)),
        ]
    ),
    st.integers(1, 6),
    st.integers(0, 2**32),
)
def test_placement_is_always_on_the_square(teacher, num_objects, seed):
    rng = np.random.default_rng(seed)
    weights = sample_uniform_weights(1, num_objects + 9, rng=rng)[0]
    layout = rng.random((num_objects, 2))
    (placement,) = show(teacher, (weights, layout), 1, seed)
    assert placement.shape == (2,)
    assert ((placement >= 0.0) & (placement <= 1.0)).all()


def test_exact_teacher_puts_the_vase_in_the_centre_and_the_spoon_in_the_bowl():
    vase, spoon = (
        show(ExactTeacher(), TRUTHS[name], 1)[0] for name in ("vase", "spoon")
    )
    np.testing.assert_allclose(vase, CENTRE, atol=1e-9)
    np.testing.assert_allclose(spoon, SPOON_LAYOUT[0], atol=1e-9)


@pytest.mark.parametrize("beta", [3.0, 100.0])
@pytest.mark.parametrize("truth", TRUTHS.values(), ids=TRUTHS)
def test_boltzmann_teacher_draws_from_the_density(truth, beta):
    answers = show(BoltzmannTeacher(beta), truth, 2500)
    for size in (8, 20):
        column, row = np.minimum((answers * size).astype(int), size - 1).T
        counts = np.bincount(row * size + column, minlength=size**2)
        expected = cell_chances(truth, beta, size).ravel() * len(answers)
        assert chi_square_p_value(counts, expected) > 0.001


def test_boltzmann_teacher_of_great_beta_has_the_spread_of_the_docstring():
    answers = show(BoltzmannTeacher(2000.0), TRUTHS["spoon"], 300)
    std = np.sqrt(0.3 / (2.0 * 2000.0))
    assert np.abs(answers.mean(axis=0) - SPOON_LAYOUT[0]).max() < 4.0 * std / 300**0.5
    np.testing.assert_allclose(answers.std(axis=0), std, rtol=4.0 / 600**0.5)


def test_boltzmann_teacher_who_wants_nothing_draws_evenly():
    answers = show(BoltzmannTeacher(), (np.zeros(13), FIRST_LAYOUT), 1000)
    for values in answers.T:
        assert stats.kstest(values, "uniform").pvalue > 0.001


@given(st.integers(0, 2**32), st.floats(0.5, 500.0))
def test_no_point_of_a_cell_exceeds_its_bound(seed, beta):
    """So a teacher of any beta draws without error."""
    rng = np.random.default_rng(seed)
    weights = beta * sample_uniform_weights(1, 13, rng=rng)[0]
    centers, points = all_centers(rng.random((4, 2))), rng.random((500, 2))
    bounds = _cell_bounds(weights, centers, WIDTHS)
    column, row = (points * len(bounds)).astype(int).T
    rewards = rbf_features(points, centers, WIDTHS) @ weights
    assert (rewards <= bounds[row, column]).all()


def test_noise_has_its_moments():
    offsets = show(NoisyTeacher(0.05), TRUTHS["vase"], 2000) - CENTRE
    assert np.abs(offsets.mean(axis=0)).max() < 4.0 * 0.05 / 2000**0.5
    np.testing.assert_allclose(offsets.std(axis=0), 0.05, rtol=4.0 / 4000**0.5)
    assert abs(np.corrcoef(offsets.T)[0, 1]) < 4.0 / 2000**0.5


def test_noise_is_clipped_at_the_edge():
    answers = show(NoisyTeacher(), TRUTHS["corner"], 400)
    on_edge = (answers == np.round(answers)).mean(axis=0)
    assert np.abs(on_edge - 0.5).max() < 4.0 * 0.5 / 400**0.5


def test_teacher_without_noise_is_exact():
    best = show(ExactTeacher(), TRUTHS["vase"], 1)[0]
    for teacher in (NoisyTeacher(0.0), BlunderingTeacher(0.0), BiasedTeacher((0, 0))):
        np.testing.assert_array_equal(show(teacher, TRUTHS["vase"], 1)[0], best)


def test_blunders_are_as_many_as_said():
    answers = show(BlunderingTeacher(0.1), TRUTHS["vase"], 2000)
    blunders = np.abs(answers - CENTRE).max(axis=1) > 1e-6
    assert stats.binomtest(int(blunders.sum()), 2000, 0.1).pvalue > 0.001


def test_blunders_are_even_on_the_square():
    answers = show(BlunderingTeacher(1.0), TRUTHS["vase"], 2000)
    for values in answers.T:
        assert stats.kstest(values, "uniform").pvalue > 0.001


def test_blunderer_answers_the_same_questions_exactly_whatever_came_before():
    """So teachers of different probabilities can be compared on the same draws."""
    few, many = (
        show(BlunderingTeacher(probability), TRUTHS["vase"], 300)
        for probability in (0.1, 0.5)
    )
    is_blunder = np.abs(few - CENTRE).max(axis=1) > 1e-6
    assert is_blunder.any()
    np.testing.assert_array_equal(few[is_blunder], many[is_blunder])


@pytest.mark.parametrize("bias", [(0.05, 0.0), (-0.1, 0.2)])
def test_bias_is_exact(bias):
    best = best_placements(VASE.true_weights[None], FIRST_LAYOUT[None], WIDTHS)[0, 0]
    answer = show(BiasedTeacher(bias), TRUTHS["vase"], 1)[0]
    np.testing.assert_array_equal(answer, best + bias)


def test_bias_is_clipped_at_the_edge():
    answer = show(BiasedTeacher((0.7, -0.1)), TRUTHS["vase"], 1)[0]
    np.testing.assert_allclose(answer, [1.0, 0.4], atol=1e-9)


@pytest.mark.parametrize("bowl", [(0.2, 0.3), (0.8, 0.9), (0.0, 1.0)])
def test_offset_goes_with_the_object(bowl):
    layout = np.array([bowl, *SPOON_LAYOUT[1:]])
    answer = show(OffsetTeacher(), (SPOON.true_weights, layout), 1)[0]
    np.testing.assert_array_equal(answer, [bowl[0] + 0.15, bowl[1]])


def test_offset_is_clipped_at_the_edge():
    layout = np.array([(0.9, 0.1), *SPOON_LAYOUT[1:]])
    answer = show(OffsetTeacher((0.2, -0.05)), (SPOON.true_weights, layout), 1)[0]
    np.testing.assert_allclose(answer, [1.0, 0.05])


def test_offset_is_from_the_object_of_the_largest_weight_not_from_the_table():
    weights = np.array([-0.4, 0.2, -0.1, 0.1, *np.linspace(0.0, 0.9, 9)])
    answer = show(OffsetTeacher((0.0, 0.1)), (weights, FIRST_LAYOUT), 1)[0]
    np.testing.assert_allclose(answer, FIRST_LAYOUT[1] + [0.0, 0.1])


def test_first_of_equal_objects_counts():
    answer = show(OffsetTeacher(), TRUTHS["vase"], 1)[0]
    np.testing.assert_allclose(answer, FIRST_LAYOUT[0] + [0.15, 0.0])


@pytest.mark.parametrize("name", TEACHERS)
def test_wishes_are_the_answers_of_the_teacher_who_makes_no_error(name):
    layouts = np.random.default_rng(0).random((5, 4, 2))
    weights = np.array([-0.1, 0.3, -0.1, -0.1, *VASE.table_weights])
    errorless = TEACHERS["offset" if name == "offset" else "exact"]
    answers = [show(errorless, (weights, layout), 1)[0] for layout in layouts]
    wishes = TEACHERS[name].wishes(weights, layouts, WIDTHS)
    np.testing.assert_allclose(wishes, answers, atol=1e-12)
