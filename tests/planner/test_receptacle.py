import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.planner.receptacle import RECEPTACLES
from tablesetting.reward.tasks import RECEPTACLE_RADIUS, TASKS
from tablesetting.scene.props import PROPS
from tablesetting.scene.table import TableFrame

BOWL = RECEPTACLES["spoon", "bowl"]
angles = st.floats(-np.pi, np.pi)


@given(st.floats(0.0, BOWL.radius), angles)
def test_every_offset_within_reach_has_a_heading(distance, angle):
    offset = distance * np.array([np.cos(angle), np.sin(angle)])
    headings = BOWL.headings(offset)
    assert len(headings) > 0
    assert all(BOWL.takes(offset, heading) for heading in headings)


@given(st.floats(0.002, BOWL.radius), angles)
def test_the_head_is_what_goes_down(distance, yaw):
    ahead = np.array([-np.sin(yaw), np.cos(yaw)])
    assert BOWL.takes(-distance * ahead, yaw)
    assert not BOWL.takes(distance * ahead, yaw)


def test_the_spoon_is_let_go_ahead_of_where_it_comes_to_rest():
    release = BOWL.release("bowl", "spoon", np.array([0.1, 0.2]), np.pi / 2)
    center = PROPS["spoon"].center_of_mass[1]
    np.testing.assert_allclose(release[:2], [0.1 - (0.0055 - center), 0.2])
    assert release[2] == pytest.approx(PROPS["bowl"].height + 0.008)


def test_the_learner_knows_of_the_same_receptacles():
    """The layers below know no simulator, and say it in table units."""
    known = {(task.item, name) for task in TASKS.values() for name in task.receptacles}
    assert known == set(RECEPTACLES)
    width = TableFrame().size[0]
    for receptacle in RECEPTACLES.values():
        assert receptacle.radius == pytest.approx(RECEPTACLE_RADIUS * width)
