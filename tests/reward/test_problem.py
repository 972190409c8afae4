import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tablesetting.irl import arrays
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import value_at_risk
from tablesetting.irl.sampler import Diagnosis, McmcConfig, sample_uniform_weights
from tablesetting.reward.config import DEFAULT, PAPER, PRESETS, PlacementConfig
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.problem import PlacementProblem, load_kernels
from tablesetting.reward.rbf import (
    TABLE_CENTERS,
    all_centers,
    rbf_features,
    reward_derivatives,
)
from tablesetting.reward.tasks import FOOTPRINTS, SPOON, TASKS, VASE
from tablesetting.reward.teachers import BiasedTeacher, NoisyTeacher, OffsetTeacher

RECORDED = Path(__file__).parents[1] / "data" / "vase_demonstrations.json"
QUICK = replace(
    DEFAULT,
    mcmc=McmcConfig(num_steps=200, burn_in=100, num_particles=16, num_samples=20),
)

PLATE_IN_THE_MIDDLE = np.array([[0.45, 0.5], [0.85, 0.2], [0.15, 0.85], [0.85, 0.8]])
TICKS = np.linspace(0.0, 1.0, 201)
GRID = np.stack(np.meshgrid(TICKS, TICKS), axis=-1).reshape(-1, 2)


def recorded_session():
    """Return layouts (11, 4, 2) and placements (11, 2) of the authors' session."""
    demos = json.loads(RECORDED.read_text())["demonstrations"]
    layouts = [[demo["layout"][name] for name in VASE.objects] for demo in demos]
    return np.array(layouts), np.array([demo["placement"] for demo in demos])


def rewards_at(placement, points, layout, weights):
    """Return the reward of a placement and those of points, shape (G,)."""
    both = np.concatenate([placement[None], points])
    squared = np.square(both[:, None] - [*layout, *TABLE_CENTERS]).sum(axis=-1)
    values = np.exp(-squared / 0.3) @ weights
    return values[0], values[1:]


def show(problem, layout):
    """Ask the teacher, who draws nothing."""
    return problem.demonstrate(layout, rng=None)


def posterior_of(weights, guessed=None):
    """Return a posterior of samples, the last of them the guess."""
    return Posterior(
        weights=weights,
        log_posts=np.arange(len(weights), dtype=float),
        scales=None,
        map_weights=weights[-1] if guessed is None else guessed,
        mean_weights=weights[-1] if guessed is None else guessed,
        guess="map",
        num_chains=1,
        acceptance_rate=0.3,
        diagnosis=Diagnosis(20.0, 20.0, 1.0),
        is_sound=True,
        log_evidence=0.0,
    )


def random_posterior(dim, num_samples=20):
    rng = np.random.default_rng(0)
    return posterior_of(sample_uniform_weights(num_samples, dim, rng=rng))


def test_no_candidates_are_refused():
    with pytest.raises(ValueError, match="`num_candidates` must be at least 1; got 0"):
        PlacementConfig(num_candidates=0)


def test_preset_of_the_paper_holds_its_numbers():
    assert (PAPER.candidates, PAPER.num_candidates) == ("one-moved", 50)
    assert PAPER.are_points
    assert (PAPER.widths.object_width, PAPER.widths.table_width) == (0.3, 0.3)
    assert (PAPER.likelihood, PAPER.guess) == ("boltzmann", None)
    assert (PAPER.boltzmann.beta, PAPER.boltzmann.beta_spread) == (100.0, 0.0)
    assert (PAPER.boltzmann.quadrature, PAPER.boltzmann.resolution) == ("lattice", 10)
    assert PAPER.mcmc == McmcConfig(
        num_chains=1,
        num_steps=2500,
        burn_in=0,
        num_particles=0,
        num_samples=100,
        target_ess=None,
        step_std=0.05,
        target_acceptance=None,
        is_prior_uniform=False,
        num_map_steps=0,
        starts_at_map=True,
    )
    assert (PAPER.risk.alpha, PAPER.risk.rank_offset) == (0.95, 1)


def test_default_preset_is_statistically_sound_and_physical():
    assert DEFAULT.mcmc.is_prior_uniform
    assert DEFAULT.mcmc.num_chains > 1
    assert DEFAULT.mcmc.burn_in > 0
    assert DEFAULT.mcmc.num_particles > 0
    assert DEFAULT.mcmc.target_ess >= 400
    assert DEFAULT.mcmc.max_rhat <= 1.01
    assert DEFAULT.likelihood == "placement"
    assert DEFAULT.boltzmann.quadrature == "gauss"
    assert (DEFAULT.risk.alpha, DEFAULT.risk.rank_offset) == (0.95, 0)
    assert not DEFAULT.are_points
    assert PRESETS == {"default": DEFAULT, "paper": PAPER}


def test_paper_puts_the_vase_in_the_centre_of_its_first_layout():
    demo = show(PlacementProblem(VASE, PAPER), np.array(VASE.first_layout))
    np.testing.assert_allclose(demo.placement, [0.5, 0.5], atol=1e-9)


@pytest.mark.parametrize("config", PRESETS.values(), ids=PRESETS)
def test_spoon_goes_into_the_bowl(config):
    problem = PlacementProblem(SPOON, config)
    for layout in problem.space.sample(5, rng=np.random.default_rng(0)):
        demo = show(problem, layout)
        np.testing.assert_allclose(demo.placement, layout[0], atol=1e-9)
        np.testing.assert_array_equal(demo.layout, layout)


def test_recorded_session_shows_the_best_placements_of_the_true_weights():
    layouts, placements = recorded_session()
    problem = PlacementProblem(VASE, PAPER)
    weights = VASE.true_weights
    best = problem.best_placements(weights[None], layouts)[:, 0]
    repeated = np.tile(weights, (len(best), 1))
    _, _, hessians = reward_derivatives(
        best, repeated, all_centers(layouts), problem.widths
    )
    # The authors climb 50 steps of 0.05 times the gradient, from somewhere on the
    # table: of an offset along the flattest direction this much is left.
    flattest = np.linalg.eigvalsh(-hessians).min(axis=1)
    left = np.sqrt(2.0) * (1.0 - 0.05 * flattest) ** 50
    assert (np.linalg.norm(placements - best, axis=1) < left).all()
    assert left.max() < 0.01


@pytest.mark.parametrize("config", PRESETS.values(), ids=PRESETS)
def test_candidates_are_as_the_preset_says(config):
    problem = PlacementProblem(VASE, config)
    rng = np.random.default_rng(0)
    demos = [show(problem, layout) for layout in problem.space.sample(2, rng=rng)]
    candidates = np.array(problem.propose_queries(demos, rng=rng))
    assert candidates.shape == (50, 4, 2)
    num_moved = (candidates != demos[-1].layout).any(axis=2).sum(axis=1)
    assert set(num_moved) == {1 if config is PAPER else 4}


def test_loss_is_the_distance_between_the_placements_of_test_loss_is_the_distance_between_the_placements_of_guess_and_sample():
    problem = PlacementProblem(VASE, DEFAULT)
    posterior = random_posterior(13)
    layouts = problem.space.sample(3, rng=np.random.default_rng(0))
    losses = problem.policy_losses(list(layouts), posterior)
    assert losses.shape == (3, 20)
    np.testing.assert_array_equal(losses[:, -1], 0.0)  # The guess is the last sample.
    for layout, row in zip(layouts, losses, strict=True):
        one = layout[None]
        best = problem.best_placements(posterior.guessed_weights[None], one)[0, 0]
        for weights, loss in zip(posterior.weights, row, strict=True):
            other = problem.best_placements(weights[None], one)[0, 0]
            assert loss == pytest.approx(np.hypot(*(best - other)), abs=1e-8)


def test_losses_are_the_same_in_blocks_of_any_size(monkeypatch):
    problem = PlacementProblem(VASE, PAPER)
    posterior = random_posterior(13)
    layouts = list(problem.space.sample(7, rng=np.random.default_rng(0)))
    whole = problem.policy_losses(layouts, posterior)
    risks = value_at_risk(whole, 0.95)
    for num_elements in (1, 45, 64):
        monkeypatch.setattr(arrays, "_BLOCK_ELEMENTS", num_elements)
        np.testing.assert_array_equal(problem.policy_losses(layouts, posterior), whole)
        np.testing.assert_array_equal(value_at_risk(whole, 0.95), risks)


def test_a_wish_may_be_under_an_object():
    problem = PlacementProblem(VASE, DEFAULT)
    problem.space.check(PLATE_IN_THE_MIDDLE)
    wish = show(problem, PLATE_IN_THE_MIDDLE).placement
    on_plate = FOOTPRINTS["plate"].distance(wish - PLATE_IN_THE_MIDDLE[0])
    assert on_plate < -0.05


@pytest.mark.parametrize("config", PRESETS.values(), ids=PRESETS)
@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_no_point_of_the_square_is_better_than_the_wish(task, config):
    """So objects may be points or things: the wish is the same."""
    problem = PlacementProblem(task, config)
    solid = LayoutSpace.of_task(task, are_points=False)
    for layout in solid.sample(10, rng=np.random.default_rng(0)):
        wish = show(problem, layout).placement
        worth, on_grid = rewards_at(wish, GRID, layout, task.true_weights)
        assert worth >= on_grid.max()


def test_risk_is_of_wishes():
    """A sample that wants the vase on the plate is not moved off it."""
    problem = PlacementProblem(VASE, DEFAULT)
    on_plate, in_corner = np.eye(13)[0], np.eye(13)[4]
    posterior = posterior_of(np.stack([on_plate, in_corner]), guessed=on_plate)
    losses = problem.policy_losses([PLATE_IN_THE_MIDDLE], posterior)
    expected = np.hypot(*(PLATE_IN_THE_MIDDLE[0] - TABLE_CENTERS[0]))
    np.testing.assert_allclose(losses, [[0.0, expected]], atol=1e-9)


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_free_placement_is_free_and_no_free_point_is_better(task):
    problem = PlacementProblem(task, DEFAULT)
    rewards = random_posterior(len(problem.widths)).weights[:9]
    for layout in problem.space.sample(5, rng=np.random.default_rng(0)):
        space = problem.space.free_space(layout, task.receptacles)
        free = GRID[space.contains(GRID)]
        for weights in (task.true_weights, *rewards):
            placement = problem.best_free_placement(weights, layout)
            assert space.contains(placement)
            worth, on_grid = rewards_at(placement, free, layout, weights)
            assert worth >= on_grid.max() - 1e-9


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_free_placement_is_the_wish_exactly_where_that_is_free(task):
    problem = PlacementProblem(task, DEFAULT)
    layouts = problem.space.sample(5, rng=np.random.default_rng(0))
    rewards = random_posterior(len(problem.widths)).weights
    wishes = problem.best_placements(rewards, layouts)
    num_free = 0
    for layout, row in zip(layouts, wishes, strict=True):
        space = problem.space.free_space(layout, task.receptacles)
        is_free = space.contains(row)
        num_free += is_free.sum()
        for weights, wish, fits in zip(rewards, row, is_free, strict=True):
            placement = problem.best_free_placement(weights, layout)
            is_wish = np.abs(placement - wish).max() < 1e-9
            assert is_wish == fits
    assert 0 < num_free < is_free.size * len(layouts)


def test_free_placement_is_in_the_bowl_that_the_spoon_is_wanted_in():
    problem = PlacementProblem(SPOON, DEFAULT)
    for layout in problem.space.sample(5, rng=np.random.default_rng(0)):
        placement = problem.best_free_placement(SPOON.true_weights, layout)
        np.testing.assert_allclose(placement, layout[0], atol=1e-6)
        np.testing.assert_array_equal(problem.free_wish(layout), placement)


def test_free_placement_leaves_the_bowl_where_nothing_is_put_into_it():
    problem = PlacementProblem(replace(SPOON, receptacles=()), DEFAULT)
    needed = FOOTPRINTS["bowl"].grow(FOOTPRINTS["spoon"], SPOON.clearance)
    for layout in problem.space.sample(5, rng=np.random.default_rng(0)):
        wish = show(problem, layout).placement
        np.testing.assert_allclose(wish, layout[0], atol=1e-9)
        placement = problem.best_free_placement(SPOON.true_weights, layout)
        assert needed.distance(placement - layout[0]) >= -1e-9


def test_receptacles_change_nothing_where_objects_are_points():
    problem = PlacementProblem(SPOON, PAPER)
    layouts = problem.space.sample(2, rng=np.random.default_rng(0))
    rewards = random_posterior(15).weights
    wishes = problem.best_placements(rewards, layouts)
    for layout, row in zip(layouts, wishes, strict=True):
        for weights, wish in zip(rewards, row, strict=True):
            placement = problem.best_free_placement(weights, layout)
            np.testing.assert_array_equal(placement, wish)


def test_points_are_in_no_wishs_way():
    problem = PlacementProblem(VASE, PAPER)
    placement = problem.best_free_placement(VASE.true_weights, PLATE_IN_THE_MIDDLE)
    wish = show(problem, PLATE_IN_THE_MIDDLE).placement
    np.testing.assert_array_equal(placement, wish)


def test_reward_map_has_its_rows_along_y_and_its_columns_along_x():
    problem = PlacementProblem(VASE, PAPER)
    layout = np.array(VASE.first_layout)
    weights = random_posterior(13).weights[0]
    reward_map = problem.reward_map(weights, layout, 5)
    assert reward_map.shape == (5, 5)
    for row, column in ((0, 0), (1, 3), (4, 2)):
        point = np.array([[column / 4, row / 4]])
        features = rbf_features(point, all_centers(layout), problem.widths)
        assert reward_map[row, column] == pytest.approx((features @ weights)[0])


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_inference_starts_at_the_previous_map_only_when_configured(task):
    problem = PlacementProblem(task, QUICK)
    layout = problem.space.sample(1, rng=np.random.default_rng(0))[0]
    demos = [show(problem, layout)]
    first = problem.infer(demos, None, rng=np.random.default_rng(1))
    assert first.weights.shape == (4 * 5, len(task.objects) + 9)
    again = problem.infer(demos, first, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(first.weights, again.weights)


@pytest.mark.parametrize("likelihood", ["boltzmann", "placement"])
@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_default_chains_mix_from_the_first_demonstration_on(task, likelihood):
    problem = PlacementProblem(task, replace(DEFAULT, likelihood=likelihood))
    rng = np.random.default_rng(0)
    demos = [show(problem, problem.space.sample(1, rng=rng)[0])]
    posterior = problem.infer(demos, None, rng=rng)
    assert posterior.ess > 200
    assert posterior.rhat < 1.03
    assert posterior.weights.shape == (400, len(task.objects) + 9)


def test_teacher_answers_and_wishes():
    layouts = np.array([VASE.first_layout, PLATE_IN_THE_MIDDLE])
    biased = PlacementProblem(VASE, PAPER, teacher=BiasedTeacher((0.05, 0.0)))
    exact = PlacementProblem(VASE, PAPER)
    wishes = exact.wishes(layouts)
    np.testing.assert_array_equal(biased.wishes(layouts), wishes)
    for layout, wish in zip(layouts, wishes, strict=True):
        np.testing.assert_allclose(show(exact, layout).placement, wish)
        np.testing.assert_allclose(show(biased, layout).placement, wish + [0.05, 0.0])

    beside = PlacementProblem(VASE, PAPER, teacher=OffsetTeacher((0.1, 0.0)))
    np.testing.assert_allclose(beside.wishes(layouts), layouts[:, 0] + [0.1, 0.0])


def test_teacher_draws_from_the_rng_that_is_given():
    problem = PlacementProblem(VASE, PAPER, teacher=NoisyTeacher())
    layout = np.array(VASE.first_layout)
    first, again, other = (
        problem.demonstrate(layout, rng=np.random.default_rng(seed)).placement
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()


def test_deployment_is_the_candidates_unless_told():
    posterior, rng = random_posterior(13), np.random.default_rng(0)
    problem = PlacementProblem(VASE, QUICK)
    candidates, met = (problem.space.sample(num, rng=rng) for num in (7, 3))
    knowing = PlacementProblem(VASE, QUICK, deployment=met)
    assumed, known = (
        each.outlook(list(candidates), posterior) for each in (problem, knowing)
    )
    np.testing.assert_array_equal(assumed.losses, known.losses)
    np.testing.assert_allclose(assumed.deployed_losses, assumed.losses)
    np.testing.assert_allclose(
        known.deployed_losses, problem.policy_losses(list(met), posterior)
    )


def test_losses_of_the_outlook_are_those_of_the_policy():
    problem, posterior = PlacementProblem(VASE, QUICK), random_posterior(13)
    layouts = list(problem.space.sample(3, rng=np.random.default_rng(0)))
    outlook = problem.outlook(layouts, posterior)
    assert outlook.num_queries == 3
    assert outlook.ess == posterior.kept_ess
    expected = problem.policy_losses(layouts, posterior)
    np.testing.assert_array_equal(outlook.losses, expected)


def test_kernels_are_loaded_without_a_word():
    load_kernels()


def test_paper_learns_where_the_vase_goes():
    layouts, _ = recorded_session()
    problem = PlacementProblem(VASE, PAPER)
    demos = [show(problem, layout) for layout in layouts]
    rng = np.random.default_rng(0)
    tests = problem.space.sample(100, rng=rng)
    truth = problem.best_placements(VASE.true_weights[None], tests)[:, 0]
    errors, previous = [], None
    for num_demos in (1, 11):
        previous = problem.infer(demos[:num_demos], previous, rng=rng)
        learned = problem.best_placements(previous.map_weights[None], tests)[:, 0]
        errors.append(np.linalg.norm(learned - truth, axis=1).mean())
    assert errors[1] < 0.08 < errors[0]
