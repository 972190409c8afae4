import numpy as np
import pytest

from tablesetting.experiments.validation import ValidationSet
from tablesetting.reward.config import DEFAULT, PRESETS
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import SPOON, TASKS, VASE


def validation_set_of(task, config=DEFAULT, num_layouts=20):
    problem = PlacementProblem(task, config)
    layouts = problem.space.sample(num_layouts, rng=np.random.default_rng(0))
    return ValidationSet.of_problem(problem, layouts)


@pytest.mark.parametrize("config", PRESETS.values(), ids=PRESETS)
@pytest.mark.parametrize("name", TASKS)
def test_the_truth_makes_no_errors_and_neither_does_its_multiple(name, config):
    validation = validation_set_of(TASKS[name], config)
    for scale in (1.0, 0.5):
        errors = validation.placement_errors(scale * TASKS[name].true_weights)
        np.testing.assert_allclose(errors, np.zeros(20), atol=1e-9)


def test_truth_is_what_the_person_shows():
    problem, validation = PlacementProblem(VASE, DEFAULT), validation_set_of(VASE)
    rng = np.random.default_rng(0)
    shown = [
        problem.demonstrate(layout, rng=rng).placement for layout in validation.layouts
    ]
    np.testing.assert_allclose(validation.true_placements, shown, atol=1e-9)


def test_error_is_the_distance_to_where_the_person_wants_the_item():
    validation = validation_set_of(SPOON)
    plate = np.eye(15)[SPOON.objects.index("plate")]
    bowls, plates = validation.layouts[:, 0], validation.layouts[:, 1]
    np.testing.assert_allclose(validation.true_placements, bowls, atol=1e-9)
    expected = np.linalg.norm(plates - bowls, axis=1)
    np.testing.assert_allclose(validation.placement_errors(plate), expected, atol=1e-8)
