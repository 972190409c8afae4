from dataclasses import replace

import numpy as np
import pytest

from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import FOOTPRINTS, SPOON, TASKS, VASE


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"item": "fridge"}, "task 'vase' names 'fridge', which has no footprint"),
        (
            {"objects": ("sink", "bowl", "glass", "cup")},
            "task 'vase' names 'sink', which has no footprint",
        ),
        ({"objects": ("plate", "bowl")}, "has 2 objects but 4 object weights"),
        ({"table_weights": (0.0,) * 8}, "has 8 table weights; give 9"),
        (
            {"receptacles": ("bowl", "fork")},
            "task 'vase' has the receptacle 'fork', which is not among its objects; "
            "take from plate, bowl, glass, cup",
        ),
    ],
)
def test_a_task_that_does_not_fit_together_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(VASE, **change)


def test_tasks_are_found_by_their_names():
    assert TASKS == {"vase": VASE, "spoon": SPOON}


@pytest.mark.parametrize("task", TASKS.values(), ids=str)
def test_true_weights_are_unit_l1_and_one_for_each_center(task):
    assert task.true_weights.shape == (len(task.objects) + 9,)
    assert np.abs(task.true_weights).sum() == pytest.approx(1.0)


def test_truth_and_first_layout_are_those_of_the_paper():
    assert VASE.true_weights.tolist() == 4 * [-0.1] + 4 * [0.0] + [0.6] + 4 * [0.0]
    assert SPOON.true_weights.tolist() == [1.0] + 14 * [0.0]
    assert SPOON.objects[0] == "bowl"
    assert VASE.first_layout == ((0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25))
    assert SPOON.first_layout is None


def test_only_the_spoon_is_put_into_something():
    assert (VASE.receptacles, SPOON.receptacles) == ((), ("bowl",))


def test_first_layout_of_the_vase_can_be_set_up_with_things_of_true_size():
    LayoutSpace.of_task(VASE, are_points=False).check(np.array(VASE.first_layout))


def test_footprints_fit_the_table():
    for footprint in FOOTPRINTS.values():
        assert 0.0 < footprint.radius + footprint.half_length < 0.5
