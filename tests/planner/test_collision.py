import numpy as np

from tablesetting.planner.collision import CollisionChecker
from tablesetting.planner.grasp import Hold, ToolPose
from tablesetting.planner.ik import IkSolver
from tablesetting.scene.robot import HOME, TCP_SITE, robot_model


def reach(position):
    """Arm joints that bring the tool, pointing down, to a position in [m]."""
    solver = IkSolver(robot_model(), TCP_SITE, np.array([*HOME, 0.0, 0.0]))
    position = np.array(position)
    result = solver.solve(position, ToolPose(position, np.pi / 2).rotation)
    assert result.is_solved
    return result.configuration[None, :6]


def above(scene, name, height):
    return (*scene.position(name)[:2], height)


def test_home_touches_nothing(vase_scene):
    checker = CollisionChecker(vase_scene)
    assert checker.first_contact(np.array([HOME]), 0.02, None) is None


def test_a_finger_in_a_bystander_is_found(vase_scene):
    checker = CollisionChecker(vase_scene)
    inside = reach(above(vase_scene, "glass", 0.08))
    message = checker.first_contact(inside, 0.025, None)
    assert message.startswith("arm and glass would meet")


def test_the_table_is_an_obstacle(vase_scene):
    checker = CollisionChecker(vase_scene)
    message = checker.first_contact(reach((0.0, 0.0, 0.010)), 0.02, None)
    assert "table" in message


def test_a_near_miss_counts_as_a_contact(vase_scene):
    checker = CollisionChecker(vase_scene)
    top, tips = 0.110, 0.016
    # Half open, so that each finger is above the wall of the glass.
    near = reach(above(vase_scene, "glass", top + tips + 0.001))
    far = reach(above(vase_scene, "glass", top + tips + 0.003))
    assert "would pass at" in checker.first_contact(near, 0.03, None)
    assert checker.first_contact(far, 0.03, None) is None


def test_what_is_held_counts_as_part_of_the_arm(vase_scene):
    checker = CollisionChecker(vase_scene)
    high = reach(above(vase_scene, "glass", 0.2))
    assert checker.first_contact(high, 0.02, None) is None
    hold = Hold(np.array([0.0, 0.0, 0.135]), 0.0)
    assert "vase" in checker.first_contact(high, 0.02, hold)


def test_checking_leaves_the_scene_alone(vase_scene):
    before = vase_scene.data.qpos.copy()
    margins = vase_scene.model.geom_margin.copy()
    checker = CollisionChecker(vase_scene)
    checker.rest_item(np.zeros(3))
    checker.first_contact(reach((0.0, 0.0, 0.2)), 0.02, None)
    np.testing.assert_array_equal(vase_scene.data.qpos, before)
    np.testing.assert_array_equal(vase_scene.model.geom_margin, margins)
