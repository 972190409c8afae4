"""Place the item: plan, carry out, and try once more if it was lost on the way."""

from collections.abc import Generator
from dataclasses import replace
from typing import Final

from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import (
    Driver,
    Execution,
    carry_out,
    outer_points,
    score,
)
from tablesetting.planner.goal import Refusal
from tablesetting.planner.grasp import GRASPS
from tablesetting.planner.load import Load, Overload
from tablesetting.planner.path import Path, Unreachable, tool_pose_at
from tablesetting.planner.pick_place import Plan, plan, transfer_heights
from tablesetting.planner.trajectory import reverse
from tablesetting.planner.watchdog import Failure, Fault, held
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS
from tablesetting.scene.scene import Scene, Snapshot

_OPENING_TIME: Final = 0.3  # [s]
_SETTLING_TIME: Final = 0.6  # Of what was dropped, in [s].


def place(
    scene: Scene,
    target: Array,
    yaw: float | None = None,
    *,
    camera: Camera | None = None,
    frame_rate: float = 30.0,
) -> Generator[Snapshot, None, Execution | Refusal]:
    """Place the scene's item.

    An item that slips or falls is put down or let go, looked for, and picked up again
    once, if it can be.

    Args:
        scene: As it stands, with the arm at home.
        target: Where the item shall be, shape (2,), in [m]; see `plan`.
        yaw: Heading that it shall have, in [rad]; see `plan`.
        camera: What planning and correction see; everything without error if None.
        frame_rate: Snapshots per second of simulated time.

    Yields:
        The state of the world, evenly spaced in simulated time.

    Returns:
        How it went, or why nothing was moved.
    """
    camera = camera or Camera(scene)
    before = outer_points(scene)
    found = plan(scene, target, yaw, camera.look())
    if isinstance(found, Refusal):
        return found
    driver = Driver(scene, frame_rate, found.goal.receptacle)
    failure = yield from carry_out(driver, found, camera)
    if failure is None or failure.fault is not Fault.LOST_GRIP:
        return score(driver, found.goal, before, failure)
    then = yield from _recover(driver, found)
    if then is not None:
        return score(driver, found.goal, before, then)
    again = plan(scene, target, yaw, camera.look())
    if isinstance(again, Refusal):
        detail = f"{failure}; then {again.reason}: {again.detail}"
        return score(driver, found.goal, before, Failure(Fault.LOST_GRIP, detail))
    failure = yield from carry_out(driver, again, camera)
    return replace(score(driver, again.goal, before, failure), num_tries=2)


def _recover(driver: Driver, found: Plan) -> Generator[Snapshot, None, Failure | None]:
    """Put down or drop what is in the jaw, and go home."""
    scene = driver.scene
    laden = Load(scene.servos, PROPS[scene.item].mass)
    wide = found.grasp.approach_opening
    failure = yield from driver.stop(laden, 0.0 if held(scene).all() else wide)
    if failure is None and held(scene).all():
        back = [reverse(step, "go back", laden) for step in reversed(driver.carried)]
        failure = yield from driver.drive(back)
    if failure is not None:
        return failure
    driver.carried.clear()
    configuration = scene.data.qpos[scene.robot.arm_qpos].copy()
    path = Path(configuration, tool_pose_at(configuration), 0.0, Load(scene.servos))
    high = max(transfer_heights(scene, GRASPS[scene.item][0]))
    try:
        path.grip("let go", wide, _OPENING_TIME)
        path.move("back off", path.pose.raised_to(max(high, path.pose.position[2])))
        path.go_home()
    except (Unreachable, Overload) as error:
        return Failure(Fault.HELD_UP, f"after losing the {scene.item}, {error}")
    path.wait("settle", _SETTLING_TIME)
    return (yield from driver.drive(path.steps))
