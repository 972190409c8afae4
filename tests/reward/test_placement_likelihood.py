import math
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tablesetting.irl.posterior import infer_posterior
from tablesetting.irl.sampler import McmcConfig, run_chains, sample_uniform_weights
from tablesetting.reward import _kernels
from tablesetting.reward.likelihood import (
    BoltzmannConfig,
    BoltzmannLikelihood,
    Demonstration,
)
from tablesetting.reward.placement import best_placements
from tablesetting.reward.placement_likelihood import (
    _LOCAL_SCALES,
    _LOCAL_SIZE,
    _SCALE_SHARES,
    LocalWalk,
    NoiseConfig,
    PlacementLikelihood,
)
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, reward_derivatives
from tablesetting.reward.tasks import VASE
from tablesetting.reward.teachers import BoltzmannTeacher

WIDTHS = np.full(13, 0.3)
FIXED = NoiseConfig(noise_std=0.03)
SAMPLED = NoiseConfig(noise_std=0.03, noise_spread=0.5)
FLOOR = 0.02  # Of the curvature at an optimum.
SPARSE = 13 * 0.6**12 - math.comb(13, 2) * 0.2**12  # Chance of a weight over 0.4.

seeds = st.integers(0, 2**32)
by_config = pytest.mark.parametrize(
    "config", [FIXED, SAMPLED], ids=["fixed", "sampled"]
)


def random_demos(num_demos, rng):
    return [Demonstration(rng.random((4, 2)), rng.random(2)) for _ in range(num_demos)]


def show(weights, layouts, noise_std, *, rng):
    """Demonstrate with noise that may lead off the table."""
    best = best_placements(weights[None], layouts, WIDTHS)[:, 0]
    noise = noise_std * rng.standard_normal(best.shape)
    return [
        Demonstration(each, placement)
        for each, placement in zip(layouts, best + noise, strict=True)
    ]


def states_of(weights, stds):
    """Append the logarithm of the noise to the weights."""
    return np.column_stack([weights, np.log(stds)])


def plain_log_likelihood(weights, std, demos, median):
    """Sum over demonstrations one at a time."""
    total = 0.0
    for demo in demos:
        best = best_placements(weights[None], demo.layout[None], WIDTHS)[0, 0]
        total -= np.square(demo.placement - best).sum() / (2.0 * std**2)
        total -= math.log(2.0 * math.pi * std**2)
        for x in demo.placement:
            low, high = ((edge - x) / (math.sqrt(2.0) * median) for edge in (0.0, 1.0))
            # Off the square, in simulations, it is as at the edge.
            total -= math.log(max(0.5 * (math.erf(high) - math.erf(low)), 0.5))
    return total


def slopes_of(weights, layout, best):
    """Return Hessian (2, 2), gradient (2,) and its derivative by the weights, (2, D)."""
    centers = all_centers(layout)
    _, gradient, hessian = reward_derivatives(
        best[None], weights[None], centers[None], WIDTHS
    )
    offsets = best - centers
    features = np.exp(-np.square(offsets).sum(axis=1) / 0.3)
    return hessian[0], gradient[0], (-2.0 / 0.3 * features[:, None] * offsets).T


def plain_jacobian(weights, layout, best, std):
    """Return how the best placement moves with the weights, shape (2, D)."""
    hessian, gradient, slopes = slopes_of(weights, layout, best)
    curvature = FLOOR * np.eye(2) - hessian
    is_held = (best <= 0.0) | (best >= 1.0)
    if is_held.any():
        # Along either axis by itself, less the steeper it is across an edge.
        diagonal = np.maximum(np.diagonal(curvature), FLOOR)
        curvature = np.diag(diagonal + is_held * np.abs(gradient) / std)
    return np.linalg.solve(curvature, slopes)


@dataclass
class Place:
    """Where a chain is, and what it knows there."""

    weights: np.ndarray
    error: float
    metric: np.ndarray
    drift: np.ndarray

    @classmethod
    def at(cls, weights, demos, precision):
        metric = 0.5 * 13**2 * np.eye(13)
        slope, error = np.zeros(13), 0.0
        std = precision**-0.5 if precision else math.inf
        for demo in demos:
            best = best_placements(weights[None], demo.layout[None], WIDTHS)[0, 0]
            jacobian = plain_jacobian(weights, demo.layout, best, std)
            metric += precision * jacobian.T @ jacobian
            slope += precision * jacobian.T @ (demo.placement - best)
            error += np.square(demo.placement - best).sum()
        return cls(weights, error, metric, 0.5 * np.linalg.solve(metric, slope))

    def log_density(self, step, scale):
        """Evaluate the density of a local step from here, but for a constant."""
        noise = step / scale - scale * self.drift
        return (
            0.5 * np.linalg.slogdet(self.metric)[1] - 0.5 * noise @ self.metric @ noise
        )


def walk_plainly(start, proposals, demos, config, power):
    """Do what `_kernels.walk_locally` does, one chain after the other."""
    num_steps, num_chains, _ = proposals.noise.shape
    states = np.empty((num_steps, num_chains, start.shape[1]))
    log_likelihoods, log_ratios = np.empty((2, num_steps, num_chains))
    for c in range(num_chains):
        weights = start[c, :13]
        std = math.exp(start[c, 13]) if config.noise_spread else config.noise_std
        for s in range(num_steps):
            here = Place.at(weights, demos, power / std**2)
            kind, scale = proposals.kinds[s, c], proposals.scales[s, c]
            noise = proposals.noise[s, c]
            if kind == _kernels.LOCAL:
                factor = np.linalg.cholesky(here.metric)
                step = scipy.linalg.solve_triangular(factor.T, noise)
                step = scale * step + scale**2 * here.drift
            else:
                step = scale * noise
                if kind != _kernels.ISOTROPIC:
                    step = np.where(np.arange(13) == kind, step, 0.0)
            norm = np.abs(weights + step).sum()
            there = Place.at((weights + step) / norm, demos, power / std**2)
            # The reverse step is the same scaled back; 13 from the map of the weights.
            moved = 1 if kind >= 0 else 13
            log_ratio = 0.5 * power / std**2 * (here.error - there.error)
            log_ratio -= (13 + moved) * math.log(norm)
            if kind == _kernels.LOCAL:
                log_ratio += there.log_density(-step / norm, scale)
                log_ratio -= here.log_density(step, scale)
            else:
                log_ratio -= np.sum((step / norm) ** 2 - step**2) / (2.0 * scale**2)
            if proposals.log_uniforms[s, c] < log_ratio:
                weights = there.weights
            likelihood = plain_log_likelihood(weights, std, demos, config.noise_std)
            if config.noise_spread:
                other = std * math.exp(proposals.std_noise[s, c])
                gain = plain_log_likelihood(weights, other, demos, config.noise_std)
                gain = power * (gain - likelihood)
                logs = np.log([other, std])
                after, before = config.noise_prior.log_density(logs)
                if proposals.std_log_uniforms[s, c] < gain + after - before:
                    std = other
                    likelihood = plain_log_likelihood(
                        weights, std, demos, config.noise_std
                    )
            states[s, c, :13] = weights
            states[s, c, 13:] = math.log(std)
            log_likelihoods[s, c] = likelihood
            log_ratios[s, c] = log_ratio
    return states, log_likelihoods, log_ratios


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"noise_std": 0.0}, "`noise_std` must be at least 0.001 .* got 0.0"),
        ({"noise_std": -0.1}, "`noise_std` must be at least 0.001 .* got -0.1"),
        ({"noise_std": math.inf}, "`noise_std` must be .* got inf"),
        ({"noise_std": math.nan}, "`noise_std` must be .* got nan"),
        ({"noise_spread": -0.1}, r"`noise_spread` must be in \[0, 2\]; got -0.1"),
        ({"noise_spread": 2.1}, r"`noise_spread` must be in \[0, 2\]; got 2.1"),
        ({"noise_spread": math.nan}, r"`noise_spread` must be in .* got nan"),
    ],
)
def test_settings_without_meaning_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        NoiseConfig(**setting)


def test_one_demonstration_by_hand():
    """The spoon is wanted in the bowl, at (0.4, 0.5), and put 0.05 beside it."""
    layout = np.array([[0.4, 0.5], [0.9, 0.9]])
    demo = Demonstration(layout, np.array([0.43, 0.54]))
    likelihood = PlacementLikelihood([demo], WIDTHS[:11], NoiseConfig(noise_std=0.05))
    expected = -0.5 * (0.05 / 0.05) ** 2 - math.log(2.0 * math.pi * 0.05**2)
    np.testing.assert_allclose(likelihood(np.eye(11)[:1]), expected)


def test_density_at_an_edge_is_twice_as_high_and_at_a_corner_four_times():
    """As half or a quarter of what is around it is on the table."""
    corner, edge, inside = np.array([0.0, 0.0]), np.array([0.5, 0.0]), [0.5, 0.5]
    expected = -math.log(2.0 * math.pi * 0.01**2)
    for placement, factor, center in ((corner, 4, 6), (edge, 2, 7), (inside, 1, 4)):
        demo = Demonstration(np.array([[0.2, 0.8]]), np.array(placement))
        weights = np.eye(10)[1 + center][None]
        found = PlacementLikelihood([demo], WIDTHS[:10], NoiseConfig())(weights)
        np.testing.assert_allclose(found, expected + math.log(factor))


@given(seeds)
def test_log_likelihood_equals_the_plain_one(seed):
    rng = np.random.default_rng(seed)
    demos, weights = random_demos(3, rng), sample_uniform_weights(4, 13, rng=rng)
    found = PlacementLikelihood(demos, WIDTHS, FIXED)(weights)
    expected = [plain_log_likelihood(w, 0.03, demos, 0.03) for w in weights]
    np.testing.assert_allclose(found, expected, rtol=1e-8)

    stds = 0.03 * rng.lognormal(0.0, 0.4, size=4)
    found = PlacementLikelihood(demos, WIDTHS, SAMPLED)(states_of(weights, stds))
    expected = [
        plain_log_likelihood(w, std, demos, 0.03)
        for w, std in zip(weights, stds, strict=True)
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@given(seeds)
def test_order_of_demonstrations_and_of_objects_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    demos, weights = random_demos(3, rng), sample_uniform_weights(4, 13, rng=rng)
    expected = PlacementLikelihood(demos, WIDTHS, FIXED)(weights)
    order = rng.permutation(4)
    renamed = [Demonstration(demo.layout[order], demo.placement) for demo in demos]
    weights[:, :4] = weights[:, order]
    found = PlacementLikelihood(renamed[::-1], WIDTHS, FIXED)(weights)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@by_config
@settings(max_examples=15)
@given(seeds, st.sampled_from([0.0, 0.2, 1.0]))
def test_compiled_steps_are_those_of_the_plain_walk(config, seed, power):
    rng = np.random.default_rng(seed)
    start = sample_uniform_weights(2, 13, rng=rng)
    demos = show(start[0], rng.random((2, 4, 2)), 0.03, rng=rng)
    if config is SAMPLED:
        start = np.hstack([start, SAMPLED.noise_prior.draw_log((2, 1), rng=rng)])
    likelihood = PlacementLikelihood(demos, WIDTHS, config)
    proposals = likelihood.mover(McmcConfig())._propose(40, 2, rng=rng)
    is_other = rng.random((40, 2)) < 0.4  # Steps of the other kinds are seldom else.
    others = rng.integers(_kernels.ISOTROPIC, 13, size=(40, 2))
    proposals = proposals._replace(kinds=np.where(is_other, others, proposals.kinds))
    found = likelihood.walk(start, proposals, power)
    expected = walk_plainly(start, proposals, demos, config, power)
    assert len(np.unique(expected[0][:, 0], axis=0)) > 1  # Some were accepted.
    np.testing.assert_allclose(found.states, expected[0], atol=1e-8)
    np.testing.assert_allclose(found.log_likelihoods, expected[1], rtol=1e-6)
    np.testing.assert_allclose(found.log_ratios, expected[2], rtol=1e-6, atol=1e-6)


@by_config
def test_a_walk_in_two_parts_is_one_walk(config):
    rng = np.random.default_rng(0)
    likelihood = PlacementLikelihood(random_demos(2, rng), WIDTHS, config)
    mover = likelihood.mover(McmcConfig())
    start, proposals = mover.prior.draw(3, rng=rng), mover._propose(60, 3, rng=rng)
    whole = likelihood.walk(start, proposals, 1.0)
    first, second = (
        type(proposals)(*(each[part] for each in proposals))
        for part in (slice(0, 25), slice(25, None))
    )
    half = likelihood.walk(start, first, 1.0).states
    rest = likelihood.walk(half[-1], second, 1.0).states
    np.testing.assert_allclose(np.concatenate([half, rest]), whole.states, atol=1e-9)


def test_steps_are_of_the_kinds_and_sizes_that_are_said():
    likelihood = PlacementLikelihood(
        random_demos(1, np.random.default_rng(0)), WIDTHS, FIXED
    )
    mover = likelihood.mover(McmcConfig())
    assert isinstance(mover, LocalWalk)
    drawn = mover._propose(2000, 20, rng=np.random.default_rng(0))
    is_local, is_isotropic = drawn.kinds == _kernels.LOCAL, drawn.kinds == -2
    assert is_local.mean() == pytest.approx(0.9, abs=0.01)
    assert is_isotropic.mean() == pytest.approx(0.05, abs=0.005)
    singles = drawn.kinds[~is_local & ~is_isotropic]
    assert stats.chisquare(np.bincount(singles, minlength=13)).pvalue > 0.001
    sizes, counts = np.unique(drawn.scales[is_local], return_counts=True)
    expected = _LOCAL_SIZE / 13**0.5 * np.array(_LOCAL_SCALES)
    np.testing.assert_allclose(sizes, expected[::-1])
    shares = counts / counts.sum()
    np.testing.assert_allclose(shares, _SCALE_SHARES[::-1], atol=0.01)
    others = np.log(drawn.scales[~is_local])
    span = np.log([1e-4, 0.3])
    assert stats.kstest((others - span[0]) / np.ptp(span), "uniform").pvalue > 0.001


def jacobian_of_the_kernel(weights, layout, best):
    """Read J off the Gauss-Newton direction A drift = J^T error / 2, shape (2, D)."""
    rows = []
    for error in np.eye(2):
        likelihood = PlacementLikelihood(
            [Demonstration(layout, best + error)], WIDTHS, FIXED
        )
        factor, drift = np.empty((13, 13)), np.empty(13)
        scratch = np.empty((2, 13))
        _kernels._metric(
            factor, drift, weights, best[None], likelihood._features, 1.0, *scratch
        )
        factor = np.tril(factor)
        rows.append(2.0 * factor @ (factor.T @ drift))
    rows = np.array(rows)
    metric = rows.T @ rows + 0.5 * 13**2 * np.eye(13)
    np.testing.assert_allclose(factor @ factor.T, metric, atol=1e-9)
    return rows


@given(seeds)
def test_best_placement_moves_with_the_weights_as_the_metric_says(seed):
    """But for the floor of the curvature, which shortens the move."""
    rng = np.random.default_rng(seed)
    layout, step = rng.random((4, 2)), 1e-6
    weights = next(
        each
        for each in sample_uniform_weights(300, 13, rng=rng)
        if is_firmly_inside(each, layout)
    )
    best = best_placements(weights[None], layout[None], WIDTHS)[0, 0]
    around = weights + step * np.vstack([np.eye(13), -np.eye(13)])
    ahead, behind = best_placements(around, layout[None], WIDTHS)[0].reshape(2, 13, 2)
    moves = (ahead - behind).T / (2.0 * step)
    hessian = slopes_of(weights, layout, best)[0]
    shortened = np.linalg.solve(FLOOR * np.eye(2) - hessian, -hessian @ moves)
    found = jacobian_of_the_kernel(weights, layout, best)
    np.testing.assert_allclose(found, shortened, rtol=1e-4, atol=1e-4)


def is_firmly_inside(weights, layout):
    """Tell whether the best placement is off the edges and well curved."""
    best = best_placements(weights[None], layout[None], WIDTHS)[0, 0]
    hessian = slopes_of(weights, layout, best)[0]
    return np.abs(best - 0.5).max() < 0.48 and np.linalg.eigvalsh(-hessian)[0] > 0.1


def test_at_an_edge_the_placement_moves_along_it_alone():
    """Wanted at the middle of the edge y = 0, steeply."""
    layout, weights = np.array([[0.1, 0.9], [0.9, 0.9]] * 2), np.zeros(13)
    weights[4 + 7], weights[4 + 1] = 0.6, -0.4
    best = best_placements(weights[None], layout[None], WIDTHS)[0, 0]
    np.testing.assert_allclose(best, TABLE_CENTERS[7], atol=1e-9)
    along, across = jacobian_of_the_kernel(weights, layout, best)
    hessian, gradient, slopes = slopes_of(weights, layout, best)
    np.testing.assert_allclose(along, slopes[0] / (FLOOR - hessian[0, 0]), atol=1e-9)
    bend = max(FLOOR - hessian[1, 1], FLOOR) + abs(gradient[1])
    np.testing.assert_allclose(across, slopes[1] / bend, atol=1e-9)


def walk_flatly(config, num_chains):
    """Take steps under a likelihood of power 0 from draws from the prior."""
    rng = np.random.default_rng(0)
    likelihood = PlacementLikelihood(random_demos(1, rng), WIDTHS, config)
    mover = likelihood.mover(McmcConfig())
    start = mover.prior.draw(num_chains, rng=rng)
    return mover.take_steps(start, likelihood(start), 2000, 0.0, rng=rng).states


def test_flat_likelihood_leaves_the_uniform_prior():
    weights = walk_flatly(FIXED, 200)
    assert SPARSE == pytest.approx(0.029, abs=0.001)
    assert np.mean(np.abs(weights).max(axis=2) > 0.4) == pytest.approx(SPARSE, abs=3e-3)
    assert np.square(weights).mean() == pytest.approx(2 / (13 * 14), abs=2e-4)
    np.testing.assert_allclose(np.abs(weights).sum(axis=2), 1.0)


def test_flat_likelihood_leaves_the_prior_of_the_noise():
    surprise = (walk_flatly(SAMPLED, 40)[..., 13] - math.log(0.03)) / 0.5
    assert np.abs(surprise).max() <= 2.0
    assert surprise.mean() == pytest.approx(0.0, abs=0.03)
    assert surprise.std() == pytest.approx(stats.truncnorm(-2.0, 2.0).std(), abs=0.03)


def test_wide_noise_is_sampled_as_importance_sampling_would():
    """So wide that draws from the prior reach all of the posterior."""
    rng = np.random.default_rng(0)
    demo = Demonstration(np.array(VASE.first_layout), np.array([0.3, 0.4]))
    likelihood = PlacementLikelihood([demo], WIDTHS, NoiseConfig(noise_std=0.1))
    mcmc = McmcConfig(num_chains=12, num_steps=6000, target_ess=None)
    states = run_chains(likelihood.mover(mcmc), mcmc, rng=rng).states
    draws = sample_uniform_weights(40_000, 13, rng=rng)
    shares = np.exp(likelihood(draws))
    shares /= shares.sum()
    for moment in (lambda w: w, np.abs):
        found, expected = moment(states).mean(axis=(0, 1)), shares @ moment(draws)
        np.testing.assert_allclose(found, expected, atol=0.012)


def test_evidence_is_the_mean_likelihood_under_the_prior():
    rng = np.random.default_rng(0)
    demo = Demonstration(np.array(VASE.first_layout), np.array([0.3, 0.4]))
    likelihood = PlacementLikelihood([demo], WIDTHS, NoiseConfig(noise_std=0.1))
    expected = np.log(
        np.exp(likelihood(sample_uniform_weights(40_000, 13, rng=rng))).mean()
    )
    mcmc = McmcConfig(num_steps=2, burn_in=0, num_samples=4, num_particles=1000)
    found = run_chains(likelihood.mover(mcmc), mcmc, rng=rng).log_evidence
    assert found == pytest.approx(expected, abs=0.15)


def test_sampled_noise_recovers_that_of_the_demonstrations():
    rng = np.random.default_rng(0)
    demos = show(VASE.true_weights, rng.random((15, 4, 2)), 0.02, rng=rng)
    config = NoiseConfig(noise_std=0.05, noise_spread=1.0)
    mcmc = McmcConfig(num_steps=3000, target_ess=None)
    likelihood = PlacementLikelihood(demos, WIDTHS, config)
    posterior = infer_posterior(likelihood, 13, mcmc, rng=rng)
    low, high = np.quantile(posterior.scales, [0.01, 0.99])
    assert 0.01 < low < 0.02 < high < 0.04


def show_boltzmann(weights, layouts, beta, *, rng):
    teacher = BoltzmannTeacher(beta)
    return [
        Demonstration(each, teacher.show(weights, each, WIDTHS, rng=rng))
        for each in layouts
    ]


MODELS = {
    "placement": (show, PlacementLikelihood, NoiseConfig(0.05), 0.05),
    "placement-sampled": (show, PlacementLikelihood, NoiseConfig(0.05, 0.5), None),
    "boltzmann": (show_boltzmann, BoltzmannLikelihood, BoltzmannConfig(30.0), 30.0),
    "boltzmann-sampled": (
        show_boltzmann,
        BoltzmannLikelihood,
        BoltzmannConfig(15.0, 0.4),
        None,
    ),
}
LOOKS = (
    lambda states: states[..., 0],
    lambda states: states[..., 8],
    lambda states: np.abs(states[..., :13]).max(axis=-1),
    lambda states: states[..., -1],  # The logarithm of noise or beta if sampled.
)


def calibrate(model, *, num_simulations, num_demos, num_steps):
    """Return p-values of the ranks of truths among samples of their posteriors.

    These are uniform if a truth is drawn from the prior and demonstrates by the very
    model (simulation-based calibration, Talts et al. 2018).
    """
    demonstrate, likelihood_of, config, fixed_scale = MODELS[model]
    mcmc = McmcConfig(
        num_chains=9,
        num_steps=num_steps,
        burn_in=num_steps // 2,
        num_particles=64,
        num_samples=9,
        target_ess=None,
    )
    anything = random_demos(1, np.random.default_rng(0))
    prior = likelihood_of(anything, WIDTHS, config).mover(mcmc)
    ranks = []
    for seed in range(num_simulations):
        rng = np.random.default_rng([0, seed])
        truth = prior.prior.draw(1, rng=rng)[0]
        scale = math.exp(truth[13]) if len(truth) > 13 else fixed_scale
        demos = demonstrate(truth[:13], rng.random((num_demos, 4, 2)), scale, rng=rng)
        mover = likelihood_of(demos, WIDTHS, config).mover(mcmc)
        last = run_chains(mover, mcmc, rng=rng).states[-1]
        ranks.append([np.sum(look(last) < look(truth)) for look in LOOKS])
    return [
        stats.chisquare(np.bincount(each, minlength=10)).pvalue
        for each in np.array(ranks).T
    ]


@pytest.mark.parametrize("model", ["placement", "boltzmann"])
def test_truths_are_to_their_posteriors_as_one_more_sample(model):
    p_values = calibrate(model, num_simulations=150, num_demos=2, num_steps=400)
    assert min(p_values) > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_many_truths_are_to_their_posteriors_as_one_more_sample(model):
    p_values = calibrate(model, num_simulations=500, num_demos=3, num_steps=1500)
    assert min(p_values) > 0.005
