"""A laid table with its robot: compiled once, posed many times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import mujoco
import numpy as np

from tablesetting.errors import InvalidLayout
from tablesetting.irl.arrays import Array, Indices
from tablesetting.scene import robot
from tablesetting.scene.controller import ArmController
from tablesetting.scene.jaw import MAX_OPENING
from tablesetting.scene.props import make_prop
from tablesetting.scene.servos import STIFF, Servos
from tablesetting.scene.table import TIMESTEP, Table, TableFrame
from tablesetting.scene.variation import PropDynamics

STAGING: Final = (0.46, -0.19)
"""Where the item stands before it is picked, in the world's xy plane, in [m]."""

_PADS: Final = ("jaco/jaw/left_pad", "jaco/jaw/right_pad")
_SETTLE_TIME: Final = 0.3  # [s]
_CONTROL_PERIOD: Final = 0.02  # While things settle, in [s].
_TOUCH: Final = -1e-4  # Props that penetrate less than this just touch, in [m].


@dataclass(frozen=True)
class Snapshot:
    """What the world looks like at one moment.

    Attributes:
        time: Simulated time since the reset, in [s].
        positions: Origin of every body of the model, shape (nbody, 3), in [m].
        quaternions: Orientation of every body, shape (nbody, 4), as wxyz.
        phase: What the robot is doing, such as "lift".
        qpos: Position of every joint, shape (nq,).
        ctrl: What the servos are told, shape (nu,).
    """

    time: float
    positions: Array
    quaternions: Array
    phase: str
    qpos: Array = field(default_factory=lambda: np.empty(0))
    ctrl: Array = field(default_factory=lambda: np.empty(0))


class Scene:
    """A table, the objects of a task, the item to place, and the robot.

    Attributes:
        model: The compiled model.
        data: Its state; owned by the scene, free to read.
        frame: Maps table units to the world.
        objects: Names of the objects in the order of a layout's rows.
        item: Name of the prop that the robot places.
        servos: What drives the arm.
        robot: Where the robot is found in `model`.
        body_ids: Body of every prop, by name.
        controller: Tells the servos what to do.
        dynamics: Mass and friction of the props, which can be varied.
    """

    def __init__(
        self,
        objects: Sequence[str],
        item: str,
        frame: TableFrame | None = None,
        *,
        servos: Servos = STIFF,
        timestep: float = TIMESTEP,
    ) -> None:
        """Compile the scene.

        Args:
            objects: Names of the props that stand on the table; each occurs once.
            item: Name of the prop to be placed.
            frame: Maps table units to the world; the default table if None.
            servos: What drives the arm.
            timestep: Of the simulation, in [s]; 0.004 is fast, 0.002 precise.

        Raises:
            ValueError: If a name occurs twice.
            TableSettingError: If there is no prop of a name.
        """
        names = (*objects, item)
        if len(set(names)) != len(names):
            raise ValueError(f"every prop may occur once; got {list(names)}")
        self.frame = TableFrame() if frame is None else frame
        self.objects = tuple(objects)
        self.item = item
        self.servos = servos
        self.model = _compile(names, self.frame, servos, timestep)
        self.data = mujoco.MjData(self.model)
        self.robot = robot.RobotIndex.of(self.model)
        self.body_ids: Mapping[str, int] = MappingProxyType(
            {name: self.model.body(f"{name}/").id for name in names}
        )
        self.controller = ArmController(self.model, self.robot, servos)
        self.dynamics = PropDynamics(
            self.model,
            bodies=np.array(list(self.body_ids.values())),
            pads=np.array([self.model.geom(pad).id for pad in _PADS]),
            table=self.model.geom("top").id,
        )

    def reset(self, centers: Array) -> None:
        """Lay the table anew and let everything come to rest.

        Every object stands upright at its centre, the item at the staging spot, the
        arm at home with its jaw half open.

        Args:
            centers: One row per object, shape (K, 2), in table units.

        Raises:
            InvalidLayout: If the shape is wrong, a coordinate is not a number, an
                object stands off the table or two props stand in each other.
        """
        self.lay(centers)
        self._check_overlaps()
        home = np.array(robot.HOME)
        num_substeps = round(_CONTROL_PERIOD / self.model.opt.timestep)
        for _ in range(round(_SETTLE_TIME / _CONTROL_PERIOD)):
            self.controller.hold(self.data, home)
            self.step(num_substeps)
        self.data.time = 0.0

    def lay(self, centers: Array) -> None:
        """Pose everything as `reset` does, without physics: objects may overlap.

        Args:
            centers: One row per object, shape (K, 2), in table units.

        Raises:
            InvalidLayout: If the shape is wrong, a coordinate is not a number or an
                object stands off the table.
        """
        centers = np.asarray(centers, dtype=np.float64)
        self._check_centers(centers)
        mujoco.mj_resetData(self.model, self.data)
        for name, xy in zip(self.objects, self.frame.to_world(centers), strict=True):
            self._stand(name, xy)
        self._stand(self.item, np.array(STAGING))
        self._home_robot()
        mujoco.mj_forward(self.model, self.data)

    def step(self, num_steps: int = 1) -> None:
        """Advance the simulation under the current controls."""
        mujoco.mj_step(self.model, self.data, num_steps)

    def snapshot(self, phase: str = "") -> Snapshot:
        """Copy the poses of all bodies."""
        return Snapshot(
            time=self.data.time,
            positions=self.data.xpos.copy(),
            quaternions=self.data.xquat.copy(),
            phase=phase,
            qpos=self.data.qpos.copy(),
            ctrl=self.data.ctrl.copy(),
        )

    def position(self, name: str) -> Array:
        """Centre of a prop's footprint in the world, shape (3,), in [m]."""
        return self.data.xpos[self.body_ids[name]].copy()

    def rotation(self, name: str) -> Array:
        """Orientation of a prop, a matrix of shape (3, 3)."""
        return self.data.xmat[self.body_ids[name]].reshape(3, 3).copy()

    def tilt(self, name: str) -> float:
        """Angle between a prop's axis and the vertical, in [rad]."""
        axis = self.rotation(name)[:, 2]
        return float(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]))

    def yaw(self, name: str) -> float:
        """Heading of a prop about the vertical in (-pi, pi], 0 as laid, in [rad]."""
        rotation = self.rotation(name)
        return float(np.arctan2(rotation[1, 0], rotation[0, 0]))

    def pose_slice(self, name: str) -> slice:
        """Where position and quaternion of a prop are in `qpos`."""
        joint = self.model.body_jntadr[self.body_ids[name]]
        start = int(self.model.jnt_qposadr[joint])
        return slice(start, start + 7)

    def center_of_mass(self, name: str) -> Array:
        """Centre of mass of a prop in the world, shape (3,), in [m]."""
        return self.data.xipos[self.body_ids[name]].copy()

    def _stand(self, name: str, xy: Array) -> None:
        self.data.qpos[self.pose_slice(name)] = [*xy, 0.0, 1.0, 0.0, 0.0, 0.0]

    def _home_robot(self) -> None:
        opening = MAX_OPENING / 2
        self.robot.set_posture(self.data, robot.HOME, opening)
        self.controller.hold(self.data, np.array(robot.HOME))
        self.data.ctrl[self.robot.jaw_ctrl] = opening

    def _check_centers(self, centers: Array) -> None:
        if centers.shape != (len(self.objects), 2):
            raise InvalidLayout(
                f"a layout of {', '.join(self.objects)} has shape "
                f"({len(self.objects)}, 2); got {centers.shape}"
            )
        inside = (centers >= 0.0) & (centers <= 1.0)  # False for NaN, too.
        for name, center, is_inside in zip(self.objects, centers, inside, strict=True):
            if not is_inside.all():
                raise InvalidLayout(
                    f"{name} is off the table at {center.round(3).tolist()}; both "
                    "coordinates must be in [0, 1]"
                )

    def _check_overlaps(self) -> None:
        names = {body: name for name, body in self.body_ids.items()}
        contact = self.data.contact
        roots = self.model.body_rootid[self.model.geom_bodyid[contact.geom]]
        for pair, distance in zip(roots, contact.dist, strict=True):
            if distance < _TOUCH and all(int(body) in names for body in pair):
                first, second = (names[int(body)] for body in pair)
                raise InvalidLayout(
                    f"{first} and {second} stand {-1e3 * distance:.1f} mm inside each "
                    "other; move their centers apart"
                )


def geom_owners(scene: Scene, names: Sequence[str]) -> Indices:
    """Say what each geom of a scene belongs to.

    Args:
        scene: The scene.
        names: "table", "arm" and every prop, in any order.

    Returns:
        An index into `names` for each geom, shape (ngeom,).
    """
    model = scene.model
    roots = model.body_rootid[model.geom_bodyid]
    owners = np.full(model.ngeom, names.index("table"))
    owners[roots == model.body("jaco/").id] = names.index("arm")
    for name, body in scene.body_ids.items():
        owners[roots == body] = names.index(name)
    return owners


def _compile(
    names: Sequence[str], frame: TableFrame, servos: Servos, timestep: float
) -> mujoco.MjModel:
    table = Table(frame, timestep=timestep)
    robot.add_robot(table, servos, timestep)
    for name in names:
        table.add_free_entity(make_prop(name))
    return robot.compile_model(table)
