import numpy as np

from tablesetting.planner.collision import CollisionChecker, Contact
from tablesetting.planner.grasp import Hold, ToolPose
from tablesetting.planner.ik import IkSolver
from tablesetting.scene.perception import Camera
from tablesetting.scene.robot import HOME, TCP_SITE, robot_model
from tablesetting.scene.servos import STIFF


def reach(position):
    """Arm joints that bring the tool, pointing down, to a position in [m]."""
    solver = IkSolver(robot_model(STIFF), TCP_SITE, np.array([*HOME, 0.0, 0.0]))
    position = np.array(position)
    result = solver.solve(position, ToolPose(position, np.pi / 2).rotation)
    assert result.is_solved
    return result.configuration[None, :6]


def checker_of(scene):
    return CollisionChecker(scene, Camera(scene).look())


def above(scene, name, height):
    return (*scene.position(name)[:2], height)


def test_home_touches_nothing(vase_scene):
    checker = checker_of(vase_scene)
    assert checker.first_contact(np.array([HOME]), 0.02, None) is None


def test_a_finger_in_a_bystander_is_found(vase_scene):
    checker = checker_of(vase_scene)
    inside = reach(above(vase_scene, "glass", 0.08))
    contact = checker.first_contact(inside, 0.025, None)
    assert (contact.mover, contact.other) == ("arm", "glass")
    assert contact.distance < 0.0


def test_the_table_is_an_obstacle(vase_scene):
    checker = checker_of(vase_scene)
    contact = checker.first_contact(reach((0.0, 0.0, 0.010)), 0.02, None)
    assert {contact.mover, contact.other} == {"arm", "table"}


def test_a_near_miss_counts_as_a_contact(vase_scene):
    checker = checker_of(vase_scene)
    top, tips = 0.110, 0.016
    # Half open, so that each finger is above the wall of the glass.
    near = reach(above(vase_scene, "glass", top + tips + 0.001))
    far = reach(above(vase_scene, "glass", top + tips + 0.003))
    assert 0.0 < checker.first_contact(near, 0.03, None).distance < 0.002
    assert checker.first_contact(far, 0.03, None) is None


def test_what_is_held_counts_as_part_of_the_arm(vase_scene):
    checker = checker_of(vase_scene)
    high = reach(above(vase_scene, "glass", 0.2))
    assert checker.first_contact(high, 0.02, None) is None
    hold = Hold(np.array([0.0, 0.0, 0.135]), 0.0)
    assert "vase" in checker.first_contact(high, 0.02, hold).mover


def test_things_are_where_they_were_seen(vase_scene):
    seen = Camera(vase_scene).look()
    seen.poses["glass"][:2] = [0.0, 0.0]
    inside = reach((0.0, 0.0, 0.08))
    assert checker_of(vase_scene).first_contact(inside, 0.025, None) is None
    contact = CollisionChecker(vase_scene, seen).first_contact(inside, 0.025, None)
    assert contact.other == "glass"


def test_a_path_is_looked_at_all_along(vase_scene):
    start, through, end = (
        reach((*(vase_scene.position("glass")[:2] + [x, 0.0]), 0.08))[0]
        for x in (-0.15, 0.0, 0.15)
    )
    path = np.vstack([np.linspace(start, through), np.linspace(through, end)])
    checker = checker_of(vase_scene)
    assert checker.first_contact(path[[0, -1]], 0.025, None) is None
    assert checker.first_contact(path, 0.025, None).other == "glass"


def test_what_is_in_hand_may_touch_the_hand(vase_scene):
    around = reach(above(vase_scene, "vase", 0.05))  # The body is thicker than the gap.
    seen = Camera(vase_scene).look()
    contact = CollisionChecker(vase_scene, seen).first_contact(around, 0.02, None)
    assert {contact.mover, contact.other} == {"arm", "vase"}
    checker = CollisionChecker(vase_scene, seen, may_touch_item=True)
    assert checker.first_contact(around, 0.02, None) is None


def test_a_contact_says_who_meets_whom():
    assert str(Contact("arm", "cup", -0.004)) == "arm and cup would meet, 4.0 mm deep"
    assert str(Contact("vase", "cup", 0.001)) == "vase and cup would pass at 1.0 mm"
    assert str(Contact("arm", "arm", 0.0)) == "the arm would get in its own way"


def test_checking_leaves_the_scene_alone(vase_scene):
    before = vase_scene.data.qpos.copy()
    margins = vase_scene.model.geom_margin.copy()
    checker = checker_of(vase_scene)
    checker.rest_item(np.zeros(3), 0.0)
    checker.first_contact(reach((0.0, 0.0, 0.2)), 0.02, None)
    np.testing.assert_array_equal(vase_scene.data.qpos, before)
    np.testing.assert_array_equal(vase_scene.model.geom_margin, margins)
