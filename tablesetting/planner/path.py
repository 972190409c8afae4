"""A path of the tool, strung together from poses and solved for the joints."""

from functools import cache
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.grasp import ToolPose
from tablesetting.planner.ik import IkConfig, IkResult, IkSolver
from tablesetting.planner.load import Load
from tablesetting.planner.trajectory import Step, move_through, wait
from tablesetting.scene.jaw import WRIST_OFFSET
from tablesetting.scene.robot import BASE_POSITION, HOME, TCP_SITE, robot_model

_SPACING: Final = 0.06  # Between two waypoints, in [m]
_TURN: Final = 0.35  # and of the tool's heading, in [rad].
_HEADING: Final = 3  # Of a polar pose, against the azimuth,
_ANGLES: Final = [1, _HEADING]  # which is the other angle.
_WRIST: Final = 5  # The joint that turns the tool about its axis.
_MAX_JUMP: Final = 0.8  # Of a joint between two waypoints, in [rad].
# A restart would land on another branch of solutions, to which no path leads.
_IK_CONFIG: Final = IkConfig(num_restarts=0, max_iterations=20)


class Unreachable(Exception):
    """The arm cannot follow a path; the message says where.

    Attributes:
        phase: Name of the step that cannot be made.
    """

    def __init__(self, phase: str, message: str) -> None:
        super().__init__(message)
        self.phase = phase


class Path:
    """Steps laid end to end; knows where the last one leaves the arm.

    Attributes:
        configuration: Arm joints at the end, shape (6,), in [rad].
        pose: Pose of the tool at the end.
        opening: Travel of each finger at the end, in [m].
        load: What the servos can do, and what they carry; may be changed on the way.
        steps: The steps so far.
    """

    def __init__(
        self, configuration: Array, pose: ToolPose, opening: float, load: Load
    ) -> None:
        self.configuration = configuration
        self.pose = pose
        self.opening = opening
        self.load = load
        self.steps: list[Step] = []
        self._solver = _make_solver()

    def move(self, phase: str, goal: ToolPose) -> None:
        """Move the tool to `goal`, pointing down all the way.

        Raises:
            Unreachable: If the arm cannot follow.
            Overload: If its joints are too weak.
        """
        self._follow(phase, goal, self._waypoints(phase, goal))

    def go_home(self) -> None:
        """Move home; the wrist, which has no stops, turns back as often as it turned.

        Raises:
            Unreachable: If the arm cannot follow.
            Overload: If its joints are too weak.
        """
        goal = home_pose()
        waypoints = self._waypoints("home", goal)
        turns = round((waypoints[-1][_WRIST] - HOME[_WRIST]) / (2.0 * np.pi))
        if turns:
            waypoints = self._waypoints("home", goal, -turns)
        self._follow("home", goal, waypoints)

    def _waypoints(self, phase: str, goal: ToolPose, turns: int = 0) -> list[Array]:
        """Solve for the way to `goal`, with some more turns of the tool, to the left."""
        waypoints, change = [self.configuration], np.zeros_like(self.configuration)
        for pose in _sweep(self.pose, goal, turns):
            # Begun where the joints get to if they go on like this: half the iterations.
            found = self._solve(phase, pose, waypoints[-1], waypoints[-1] + change)
            change = found - waypoints[-1]
            waypoints.append(found)
        return waypoints

    def _follow(self, phase: str, goal: ToolPose, waypoints: list[Array]) -> None:
        step = move_through(phase, np.array(waypoints), self.opening, self.load)
        self.steps.append(step)
        self.configuration, self.pose = waypoints[-1], goal

    def grip(self, phase: str, opening: float, duration: float) -> None:
        """Send the fingers to `opening`, in [m], and give them time, in [s]."""
        self.opening = opening
        self.wait(phase, duration)

    def wait(self, phase: str, duration: float) -> None:
        """Stand still, in [s]."""
        step = wait(phase, self.configuration, self.opening, duration, self.load)
        self.steps.append(step)

    def _solve(
        self, phase: str, pose: ToolPose, previous: Array, guess: Array
    ) -> Array:
        start = _with_jaw(guess)
        result = self._solver.solve(pose.position, pose.rotation, start)
        configuration = result.configuration[: previous.size]
        if not result.is_solved:
            raise Unreachable(phase, _describe(phase, pose, result))
        if np.abs(configuration - previous).max() > _MAX_JUMP:
            raise Unreachable(phase, f"{phase}: the arm would swing at {_at(pose)}")
        return configuration


@cache
def home_pose() -> ToolPose:
    """Pose of the tool when the arm is at home."""
    return tool_pose_at(np.array(HOME))


def tool_pose_at(configuration: Array) -> ToolPose:
    """Pose of the tool at an arm configuration, shape (6,), in [rad]."""
    position, rotation = _make_solver().forward(_with_jaw(configuration))
    return ToolPose(position, float(np.arctan2(rotation[1, 0], rotation[0, 0])))


@cache
def _make_solver() -> IkSolver:
    return IkSolver(robot_model(), TCP_SITE, _with_jaw(np.array(HOME)), _IK_CONFIG)


def _with_jaw(configuration: Array) -> Array:
    """Append the two fingers, which do not move the tool centre point."""
    return np.append(configuration, [0.0, 0.0])


def _sweep(start: ToolPose, goal: ToolPose, turns: int) -> list[ToolPose]:
    """Poses after `start` up to `goal`: the wrist moves in polar coordinates."""
    first, last = _to_polar(start), _to_polar(goal)
    change = last - first
    change[_ANGLES] = np.mod(change[_ANGLES] + np.pi, 2.0 * np.pi) - np.pi
    change[_HEADING] += 2.0 * np.pi * turns
    distance = np.linalg.norm(goal.position - start.position)
    num = 1 + int(max(distance / _SPACING, abs(change[_HEADING]) / _TURN))
    fractions = np.linspace(0.0, 1.0, num + 1)[1:, None]
    return [_from_polar(row) for row in first + fractions * change]


def _to_polar(pose: ToolPose) -> Array:
    x, y = pose.wrist
    azimuth = np.arctan2(y, x)
    return np.array([np.hypot(x, y), azimuth, pose.position[2], pose.yaw - azimuth])


def _from_polar(row: Array) -> ToolPose:
    radius, azimuth, height, heading = row
    yaw = azimuth + heading
    wrist = radius * np.array([np.cos(azimuth), np.sin(azimuth)]) + BASE_POSITION[:2]
    x, y = wrist + WRIST_OFFSET * np.array([np.cos(yaw), np.sin(yaw)])
    return ToolPose(np.array([x, y, height]), float(yaw))


def _at(pose: ToolPose) -> str:
    x, y, z = pose.position
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


def _describe(phase: str, pose: ToolPose, result: IkResult) -> str:
    return (
        f"{phase}: the arm does not reach {_at(pose)}; it comes as close as "
        f"{1e3 * result.position_error:.1f} mm"
    )
