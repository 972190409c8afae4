import math
from dataclasses import replace
from itertools import pairwise, product
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl import sampler
from tablesetting.irl.random_walk import RandomWalk
from tablesetting.irl.sampler import (
    Diagnosis,
    LogNormal,
    McmcConfig,
    Walk,
    WithPrior,
    _looks,
    run_chains,
    sample_uniform_weights,
)

DIM = 13  # Weights of the vase task.
FLAT = McmcConfig(
    num_chains=200, num_steps=6000, burn_in=3000, num_particles=200, target_ess=None
)
FIXED_STEP = replace(FLAT, target_acceptance=None)
PAPER_CHAIN = replace(FIXED_STEP, is_prior_uniform=False)
UNANNEALED = replace(FLAT, num_steps=2500, burn_in=500, num_particles=0, step_std=0.5)
SHORT = McmcConfig(num_chains=3, num_steps=40, burn_in=10, num_samples=3)
ONE_STEP = McmcConfig(
    num_chains=1,
    num_steps=2,
    burn_in=1,
    num_particles=1000,
    num_samples=1,
    target_ess=None,
)

# Magnitudes of a uniform point of the L1 sphere are Dirichlet(1, ..., 1): spacings.
SPARSE = DIM * 0.6 ** (DIM - 1) - math.comb(DIM, 2) * 0.2 ** (DIM - 1)
MEAN_LARGEST = sum(1 / k for k in range(1, DIM + 1)) / DIM
MEAN_SQUARE = 2 / (DIM * (DIM + 1))


def flat(weights):
    return np.zeros(len(weights))


def impossible(weights):
    return np.where(weights[:, 0] > 0.9, 0.0, -np.inf)


def tilted(weights):
    """A smooth target that favours one edge of the L1 sphere."""
    return 3.0 * weights[:, 0] - 8.0 * (weights[:, -1] - 0.4) ** 2


def normal_at(*mode, spread):
    """A target around some weights."""
    return lambda weights: -0.5 * np.square((weights - mode) / spread).sum(axis=1)


def two_modes(weights):
    """Four fifths about the center of a face of the L1 sphere, the rest opposite."""
    center = np.full(3, 1 / 3)
    large, small = (
        normal_at(*mode, spread=0.05)(weights) for mode in (center, -center)
    )
    return np.logaddexp(large + math.log(0.8), small + math.log(0.2))


def largest(weights):
    return np.abs(weights).max(axis=-1)


def along_the_circle(weights):
    """How far two weights are along the four straight sides of their circle."""
    x, y = weights.reshape(-1, 2).T
    side = np.where(y > 0, np.where(x > 0, 0, 1), np.where(x < 0, 2, 3))
    return side + np.abs(y)


def sphere_grid(dim, num=400):
    """Centers of cells of equal measure of the L1 sphere, in two or three dimensions."""
    if dim == 2:
        magnitudes = (np.arange(num * 10) + 0.5)[:, None] / (num * 10)
    else:
        corners = np.indices((num, num)).reshape(2, -1).T
        magnitudes = np.concatenate([corners + 1 / 3, corners + 2 / 3]) / num
        magnitudes = magnitudes[magnitudes.sum(axis=1) < 1.0]
    rest = 1.0 - magnitudes.sum(axis=1, keepdims=True)
    signs = product((-1, 1), repeat=dim)
    return np.concatenate([np.hstack([magnitudes, rest]) * each for each in signs])


def sample(log_likelihood, dim, config, *, start=None, seed=0):
    mover = RandomWalk(log_likelihood, dim, config)
    return run_chains(mover, config, start=start, rng=np.random.default_rng(seed))


class Counter:
    """Counts its steps: these are the states, and the first are the most probable."""

    def __init__(self, *, num_refused=0):
        self.num_refused = num_refused
        self.num_steps = 0
        self.adapted_after = []
        self.num_adapted = {"annealing": 0, "burn-in": 0}
        self.num_moved = []
        self.powers = []

    @property
    def prior(self):
        return self

    def draw(self, num, *, rng):
        return np.zeros((num, 1))

    def log_likelihood(self, states):
        return -states[..., 0]

    def log_density(self, states):
        return np.zeros(states.shape[:-1])

    def take_steps(self, start, log_likelihoods, num_steps, power, *, rng):
        counts = np.arange(self.num_steps + 1.0, self.num_steps + 1.0 + num_steps)
        self.num_steps += num_steps
        self.num_moved.append(len(start))
        self.powers.append(power)
        counts = np.repeat(counts[:, None], len(start), axis=1)
        refused = np.where(counts <= self.num_refused, -np.inf, 0.0)
        return Walk(counts[..., None], -counts, refused)

    def adapt(self, walked, *, is_annealing):
        self.adapted_after.append(self.num_steps)
        self.num_adapted["annealing" if is_annealing else "burn-in"] += 1


class Aimless(Counter):
    """Draws each state anew, or keeps it; the first are numbered."""

    def __init__(self, *, moves):
        super().__init__()
        self.moves = moves

    def draw(self, num, *, rng):
        return np.arange(float(num))[:, None]

    def log_likelihood(self, states):
        return np.zeros(len(states))

    def take_steps(self, start, log_likelihoods, num_steps, power, *, rng):
        shape = (num_steps, *start.shape)
        kept = np.broadcast_to(start, shape)
        states = rng.standard_normal(shape) if self.moves else kept
        return Walk(states, np.zeros(shape[:2]), np.zeros(shape[:2]))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"num_chains": 0}, "`num_chains` must be at least 1; got 0"),
        ({"num_samples": 0}, "`num_samples` must be at least 1; got 0"),
        ({"steps_per_rung": 0}, "`steps_per_rung` must be at least 1; got 0"),
        ({"num_particles": 3}, "at least the number of chains, 4; got 3"),
        ({"num_particles": -1}, "`num_particles` must be 0 or at least .* got -1"),
        ({"burn_in": 100, "num_steps": 100}, "got burn_in=100 with num_steps=100"),
        ({"burn_in": -1}, "got burn_in=-1"),
        (
            {"num_steps": 1099, "num_samples": 397},
            "`num_samples` must be at most 4 chains of 99 steps; got 397",
        ),
        ({"step_std": 0.0}, "`step_std` must be positive; got 0.0"),
        ({"step_std": math.nan}, "`step_std` must be positive; got nan"),
        ({"target_ess": 0.0}, "`target_ess` must be positive; got 0.0"),
        ({"max_rhat": 1.0}, "`max_rhat` must be over 1; got 1.0"),
    ],
)
def test_settings_without_meaning_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        McmcConfig(**setting)


def test_direct_draws_are_uniform_on_the_sphere():
    weights = sample_uniform_weights(100_000, DIM, rng=np.random.default_rng(0))
    np.testing.assert_allclose(np.abs(weights).sum(axis=1), 1.0)
    assert np.mean(largest(weights) > 0.4) == pytest.approx(SPARSE, abs=0.002)
    assert largest(weights).mean() == pytest.approx(MEAN_LARGEST, abs=0.001)
    assert np.mean(weights > 0) == pytest.approx(0.5, abs=0.002)


@pytest.mark.parametrize("config", [FLAT, FIXED_STEP], ids=["adapted", "fixed"])
@pytest.mark.parametrize("start", [None, np.tile(np.eye(DIM)[0], (200, 1))])
def test_chain_has_a_uniform_prior(config, start):
    weights = sample(flat, DIM, config, start=start).states
    assert SPARSE == pytest.approx(0.029, abs=0.001)
    assert np.mean(largest(weights) > 0.4) == pytest.approx(SPARSE, abs=0.003)
    assert largest(weights).mean() == pytest.approx(MEAN_LARGEST, abs=0.002)
    assert np.square(weights).mean() == pytest.approx(MEAN_SQUARE, abs=1e-4)
    np.testing.assert_allclose(weights.mean(axis=(0, 1)), 0.0, atol=0.01)


def test_chain_of_the_paper_shuns_sparse_weights():
    weights = sample(flat, DIM, replace(PAPER_CHAIN, num_particles=0)).states
    assert np.mean(largest(weights) > 0.4) == pytest.approx(0.0007, abs=0.0003)


def with_prior(log_likelihood, log_prior):
    mover = RandomWalk(log_likelihood, 2, UNANNEALED)
    return WithPrior(mover, log_prior)


@pytest.mark.parametrize(
    "mover",
    [
        RandomWalk(tilted, 2, UNANNEALED),
        RandomWalk(tilted, 2, replace(UNANNEALED, target_acceptance=None)),
        with_prior(flat, tilted),
        with_prior(tilted, flat),
        with_prior(lambda w: 3.0 * w[:, 0], lambda w: -8.0 * (w[:, 1] - 0.4) ** 2),
    ],
    ids=["adapted", "fixed", "all prior", "flat prior", "prior and likelihood"],
)
def test_chain_in_two_dimensions_follows_the_target_density(mover):
    grid = sphere_grid(2)
    density = np.exp(tilted(grid))
    bins = {"bins": 16, "range": (0, 4)}
    expected = np.histogram(along_the_circle(grid), weights=density, **bins)[0]

    config = replace(UNANNEALED, num_steps=1500)
    chains = run_chains(mover, config, rng=np.random.default_rng(0))
    found = np.histogram(along_the_circle(chains.states), **bins)[0]
    np.testing.assert_allclose(
        found / found.sum(), expected / expected.sum(), atol=0.006
    )
    log_posts = tilted(chains.states.reshape(-1, 2)).reshape(chains.log_posts.shape)
    np.testing.assert_allclose(chains.log_posts, log_posts)


def on_the_right(weights):
    """The log density of a prior that most of the sphere does not have."""
    return np.where(weights[:, 0] > 0.5, 0.0, -np.inf)


def test_particles_enter_the_support_of_a_prior_and_chains_stay_there():
    config = replace(UNANNEALED, num_steps=1500, num_particles=400)
    mover = with_prior(flat, on_the_right)
    chains = run_chains(mover, config, rng=np.random.default_rng(0))
    first = chains.states[..., 0]
    assert first.min() > 0.5
    found = np.histogram(first, bins=5, range=(0.5, 1.0))[0] / first.size
    np.testing.assert_allclose(found, 1 / 5, atol=0.01)


@pytest.mark.parametrize("num_particles", [0, 200])
def test_a_prior_that_no_start_has_is_refused(num_particles):
    config = replace(UNANNEALED, num_particles=num_particles)
    mover = with_prior(flat, lambda weights: np.full(len(weights), -np.inf))
    with pytest.raises(ValueError, match="the posterior is zero where chains would"):
        run_chains(mover, config, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("log_prior", "message"),
    [
        (lambda w: -20.0 * (w**2).sum(), r"of shape \(4,\); got shape \(\)"),
        (lambda w: -(w**2), r"of shape \(4,\); got shape \(4, 2\)"),
        (lambda w: np.where(w[:, 0] > 0, 0.0, np.nan), "finite, or -inf .* got nan"),
        (lambda w: np.where(w[:, 0] > 0, 0.0, np.inf), "finite, or -inf .* got inf"),
    ],
    ids=["scalar", "of each weight", "nan", "infinite"],
)
def test_what_is_no_log_density_is_refused(log_prior, message):
    states = np.array([[0.5, 0.5], [-0.5, 0.5], [0.1, -0.9], [-1.0, 0.0]])
    with pytest.raises(ValueError, match="`log_prior` must .*" + message):
        with_prior(flat, log_prior).log_likelihood(states)


def test_another_prior_leaves_further_parameters_with_theirs():
    scale_prior = LogNormal(median=1.0, spread=0.5)
    config = replace(UNANNEALED, num_steps=1000)
    mover = WithPrior(RandomWalk(flat, 2, config, scale_prior), tilted)
    chains = run_chains(mover, config, rng=np.random.default_rng(0))
    states = chains.states.reshape(-1, 3)
    expected = tilted(states[:, :2]) + scale_prior.log_density(states[:, 2])
    np.testing.assert_allclose(chains.log_posts.ravel(), expected)
    draws = scale_prior.draw_log((100_000,), rng=np.random.default_rng(1))
    np.testing.assert_allclose(
        np.quantile(states[:, 2], [0.1, 0.5, 0.9]),
        np.quantile(draws, [0.1, 0.5, 0.9]),
        atol=0.02,
    )


@given(st.integers(0, 2**32), st.booleans(), st.sampled_from([None, 0.234]))
def test_every_state_is_on_the_sphere_with_its_own_log_posterior(
    seed, is_prior_uniform, target_acceptance
):
    config = replace(
        SHORT,
        num_particles=8,
        is_prior_uniform=is_prior_uniform,
        target_acceptance=target_acceptance,
    )
    chains = sample(tilted, 4, config, seed=seed)
    assert chains.states.shape == (30, 3, 4)
    np.testing.assert_allclose(np.abs(chains.states).sum(axis=2), 1.0)
    expected = tilted(chains.states.reshape(-1, 4)).reshape(30, 3)
    np.testing.assert_allclose(chains.log_posts, expected)
    assert 0.0 <= chains.acceptance_rate <= 1.0
    best = tilted(chains.best_state[None])[0]
    assert best >= chains.log_posts.max() - 1e-12


def test_best_state_may_come_from_the_burn_in():
    chains = run_chains(
        Counter(), replace(SHORT, num_particles=0), rng=np.random.default_rng(0)
    )
    assert chains.best_state == 1.0
    assert chains.states.min() == 11.0


def test_acceptance_is_counted_after_the_burn_in_alone():
    config = replace(SHORT, num_particles=0)
    for num_refused, expected in ((10, 1.0), (25, 0.5)):
        mover = Counter(num_refused=num_refused)
        chains = run_chains(mover, config, rng=np.random.default_rng(0))
        assert chains.acceptance_rate == expected


@pytest.mark.parametrize("burn_in", [0, 25, 39])
def test_proposals_adapt_in_the_burn_in_alone(burn_in):
    mover = Counter()
    config = replace(SHORT, num_particles=0, burn_in=burn_in)
    run_chains(mover, config, rng=np.random.default_rng(0))
    assert mover.num_steps == 40
    assert max(mover.adapted_after, default=0) == burn_in
    assert set(mover.powers) == {1.0}


def test_movers_are_told_whether_particles_or_chains_have_moved():
    mover = Counter()
    run_chains(mover, replace(SHORT, num_particles=6), rng=np.random.default_rng(0))
    assert mover.num_adapted == {"annealing": 1, "burn-in": 1}


def test_particles_and_chains_step_in_the_numbers_that_are_set():
    mover = Counter()
    config = replace(SHORT, num_particles=6, steps_per_rung=5)
    run_chains(mover, config, rng=np.random.default_rng(0))
    assert mover.num_moved == [6, 3, 3]
    assert mover.num_steps == 5 + 40


def test_chains_start_where_they_are_told_to():
    start = sample_uniform_weights(3, 4, rng=np.random.default_rng(0))
    config = replace(SHORT, step_std=1e-9, burn_in=0, target_acceptance=None)
    chains = sample(tilted, 4, config, start=start)
    np.testing.assert_allclose(chains.states[0], start, atol=1e-6)
    assert math.isnan(chains.log_evidence)


def test_chains_start_at_any_of_the_particles_but_each_at_another():
    config = replace(SHORT, num_particles=12)
    starts = [
        run_chains(Aimless(moves=False), config, rng=np.random.default_rng(seed))
        .states[0]
        .ravel()
        for seed in range(40)
    ]
    assert all(len(np.unique(each)) == 3 for each in starts)
    assert set(np.ravel(starts)) == set(range(12))


def test_same_seed_gives_the_same_chain_and_another_seed_another():
    config = McmcConfig(num_chains=2, num_steps=600, burn_in=300)
    first, again, other = (sample(tilted, 5, config, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.states, again.states)
    np.testing.assert_array_equal(first.log_posts, again.log_posts)
    assert first.log_evidence == again.log_evidence != other.log_evidence
    assert first.diagnosis == again.diagnosis
    assert not np.array_equal(first.states, other.states)


def test_power_of_the_likelihood_rises_from_rung_to_rung_to_one():
    class Recorder(RandomWalk):
        powers = ()

        def adapt(self, walked, *, is_annealing):
            assert is_annealing
            super().adapt(walked, is_annealing=is_annealing)

        def take_steps(self, start, log_likelihoods, num_steps, power, *, rng):
            self.powers += (power,)
            return super().take_steps(start, log_likelihoods, num_steps, power, rng=rng)

    target = normal_at(0.6, -0.3, 0.1, spread=0.02)
    mover = Recorder(target, 3, replace(SHORT, burn_in=0))
    run_chains(mover, replace(SHORT, burn_in=0), rng=np.random.default_rng(0))
    assert len(mover.powers) > 4
    assert mover.powers[-2:] == (1.0, 1.0)  # The last rung and the chains.
    assert all(low < high for low, high in pairwise((0.0, *mover.powers[:-1])))


@pytest.mark.parametrize(
    ("log_likelihood", "dim", "tolerance"),
    [
        (flat, 2, 1e-12),
        (lambda weights: flat(weights) - 7.0, DIM, 1e-12),
        (tilted, 2, 0.05),
        (tilted, 3, 0.05),
        (normal_at(0.7, 0.3, spread=0.02), 2, 0.06),
        (normal_at(0.6, -0.3, 0.1, spread=0.05), 3, 0.08),
        (two_modes, 3, 0.08),
        (impossible, 2, 0.1),
    ],
)
def test_annealing_finds_the_evidence(log_likelihood, dim, tolerance):
    found = [
        sample(log_likelihood, dim, ONE_STEP, seed=seed).log_evidence
        for seed in range(20)
    ]
    grid = sphere_grid(dim) if dim < 4 else np.eye(dim)
    expected = math.log(np.exp(log_likelihood(grid)).mean())
    assert math.log(np.exp(found).mean()) == pytest.approx(expected, abs=tolerance)


def test_evidence_moves_with_a_shift_of_the_log_likelihood():
    plain = sample(tilted, 3, SHORT)
    shifted = sample(lambda weights: tilted(weights) - 1000.0, 3, SHORT)
    expected = plain.log_evidence - 1000.0
    assert shifted.log_evidence == pytest.approx(expected)


def test_without_annealing_there_is_no_evidence():
    chains = sample(tilted, 3, replace(SHORT, num_particles=0))
    assert math.isnan(chains.log_evidence)


def test_annealing_finds_two_modes_in_proportion():
    config = McmcConfig(
        num_chains=20, num_steps=60, burn_in=50, num_samples=20, target_ess=None
    )
    shares = [
        np.mean(sample(two_modes, 3, config, seed=seed).states.sum(axis=-1) > 0.0)
        for seed in range(150)
    ]
    assert np.mean(shares) == pytest.approx(0.8, abs=0.03)
    assert np.mean(np.equal(shares, 1.0)) < 0.1


def test_rhat_tells_that_short_chains_stand_in_different_modes():
    config = McmcConfig(
        num_chains=6,
        num_steps=3000,
        num_particles=0,
        step_std=0.03,
        target_acceptance=None,
    )
    for seed in range(5):
        chains = sample(two_modes, 3, config, seed=seed)
        is_large = chains.states.sum(axis=-1) > 0.0
        assert (is_large == is_large[0]).all()
        assert 0.0 < is_large[0].mean() < 1.0
        assert chains.diagnosis.rhat > 1.1
        assert not chains.diagnosis.is_sound(config)


@pytest.mark.parametrize("seed", range(3))
def test_chains_end_at_the_first_look_at_which_they_are_sound(seed):
    config = McmcConfig(num_particles=0)
    chains = sample(tilted, 5, config, seed=seed)
    looks = [num for num in _looks(config) if num <= len(chains.states)]
    sound = [Diagnosis.of_chains(chains.states[:num]).is_sound(config) for num in looks]
    assert looks[-1] == len(chains.states) < config.num_steps - config.burn_in
    assert sound == [False] * (len(looks) - 1) + [True]
    assert len(looks) > 1


def test_chains_say_that_their_steps_are_spent():
    config = McmcConfig(num_steps=1500)
    chains = sample(tilted, DIM, config)
    assert len(chains.states) == 500
    assert not chains.diagnosis.is_sound(config)


def test_a_target_above_the_states_of_a_plain_look_can_be_reached():
    config = McmcConfig(target_ess=3000.0, num_samples=4)
    chains = run_chains(Aimless(moves=True), config, rng=np.random.default_rng(0))
    assert len(chains.states) == 1000
    assert chains.diagnosis.is_sound(config)


def test_chains_without_a_target_take_all_their_steps():
    config = McmcConfig(num_steps=4000, target_ess=None)
    assert len(sample(flat, 2, config).states) == 3000


@given(st.integers(1, 8), st.integers(1, 5000), st.integers(1, 9000))
def test_looks_grow_from_enough_to_thin_from_to_all_steps(
    num_chains, num_samples, num_steps
):
    num_samples = min(num_samples, num_chains * num_steps)
    config = McmcConfig(
        num_chains=num_chains,
        num_steps=num_steps,
        burn_in=0,
        num_samples=num_samples,
    )
    looks = list(_looks(config))
    assert looks == sorted(set(looks))
    assert looks[-1] == num_steps
    assert looks[0] * num_chains >= num_samples


@pytest.mark.parametrize(
    ("ess", "rhat", "expected"),
    [
        ((400.0, 400.0), 1.01, True),
        ((399.0, 800.0), 1.0, False),
        ((800.0, 399.0), 1.0, False),
        ((800.0, 800.0), 1.02, False),
        ((800.0, 800.0), math.nan, False),
    ],
)
def test_chains_are_sound_by_both_sample_sizes_and_rhat(ess, rhat, expected):
    assert Diagnosis(*ess, rhat).is_sound(McmcConfig()) is expected


def test_without_a_target_chains_are_sound_by_rhat_unless_they_stand_still():
    config = McmcConfig(target_ess=None)
    assert Diagnosis(4.0, 4.0, 1.01).is_sound(config)
    assert not Diagnosis(4.0, 4.0, 1.02).is_sound(config)
    assert not Diagnosis(1.0, 1.0, 1.0).is_sound(config)


@given(st.integers(1, 8), st.integers(4, 3000), st.integers(0, 1500))
def test_a_look_takes_in_states_enough_for_the_target(
    num_chains, num_states, target_ess
):
    steps = np.arange(float(num_states))[:, None, None]
    states = np.broadcast_to(steps, (num_states, num_chains, 1))
    measures = "bulk_ess", "tail_ess", "rank_normalized_rhat"
    with mock.patch.multiple(sampler, **dict.fromkeys(measures, lambda x: x)):
        looked_at = Diagnosis.of_chains(states, target_ess).bulk_ess
    assert looked_at.shape[::2] == (num_chains, 1)
    enough = min(num_states, max(500, 4 * target_ess / num_chains))
    assert looked_at.shape[1] > enough / 2
    assert len(np.unique(np.diff(looked_at, axis=1))) == 1


def test_too_few_states_to_be_halved_are_not_sound():
    states = np.random.default_rng(0).random((3, 4, 2))
    assert Diagnosis.of_chains(states) == Diagnosis(1.0, 1.0, math.inf)


@pytest.mark.parametrize("name", ["median", "spread"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_a_prior_of_a_scale_without_meaning_is_refused(name, value):
    settings = {"median": 1.0, "spread": 1.0, name: value}
    with pytest.raises(ValueError, match=f"`{name}` must be positive; got {value}"):
        LogNormal(**settings)


def test_log_normal_draws_follow_its_density_within_two_spreads():
    prior = LogNormal(median=3.0, spread=0.5)
    draws = prior.draw_log((200, 500), rng=np.random.default_rng(0))
    center = math.log(3.0)
    assert np.abs(draws - center).max() <= 1.0
    edges = center + np.linspace(-1.0, 1.0, 9)
    points = edges[0] + (np.arange(800) + 0.5) / 400
    expected = np.exp(prior.log_density(points)).reshape(8, 100).sum(axis=1)
    found = np.histogram(draws, bins=edges)[0] / draws.size
    np.testing.assert_allclose(found, expected / expected.sum(), atol=0.005)


def test_log_normal_density_by_hand():
    prior = LogNormal(median=2.0, spread=0.5)
    offsets = np.array([[-1.01, -1.0], [0.0, 0.5], [0.99, 1.01]])
    expected = [[-math.inf, -2.0], [0.0, -0.5], [-0.5 * 1.98**2, -math.inf]]
    found = prior.log_density(math.log(2.0) + offsets)
    np.testing.assert_allclose(found, expected)
