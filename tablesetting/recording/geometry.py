"""The bodies of a MuJoCo model as Rerun entities, one each, in world poses."""

from collections.abc import Iterable

import mujoco
import numpy as np
import rerun as rr

from tablesetting.irl.arrays import Array
from tablesetting.recording.entities import BODIES
from tablesetting.recording.shapes import geom_rgba, geom_shape

_FIRST_HIDDEN_GROUP = 3  # MuJoCo's custom: geoms from here on are collision shapes.


def body_path(model: mujoco.MjModel, body: int) -> str:
    """Name the entity of a body.

    All bodies are siblings: nested entities would compound their world poses, so the
    slashes of dm_control's names become dots.
    """
    name = model.body(body).name or f"body_{body}"
    return f"{BODIES}/{_entity_name(name)}"


def drawn_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """List the geoms of a body to draw: the visual ones, else the collision shapes."""
    start = int(model.body_geomadr[body])
    geoms = [start + k for k in range(int(model.body_geomnum[body]))]
    geoms = [g for g in geoms if geom_rgba(model, g)[3] > 0.0]
    visual = [g for g in geoms if model.geom_group[g] < _FIRST_HIDDEN_GROUP]
    return visual or geoms


def moving_bodies(model: mujoco.MjModel) -> list[int]:
    """List the bodies that are drawn and can move."""
    movable = np.flatnonzero(model.body_weldid != 0)
    return [int(body) for body in movable if drawn_geoms(model, int(body))]


def log_model(stream: rr.RecordingStream, model: mujoco.MjModel) -> None:
    """Log every shape once, and one lasting pose for each body that never moves."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for body in range(model.nbody):
        path = body_path(model, body)
        for geom in drawn_geoms(model, body):
            name = _entity_name(model.geom(geom).name or f"geom_{geom}")
            stream.log(f"{path}/{name}", *geom_shape(model, geom), static=True)
        if model.body_weldid[body] == 0 and drawn_geoms(model, body):
            pose = rr.Transform3D(
                translation=data.xpos[body], quaternion=np.roll(data.xquat[body], -1)
            )
            stream.log(path, pose, static=True)


def send_poses(
    stream: rr.RecordingStream,
    model: mujoco.MjModel,
    indexes: Iterable[rr.TimeColumn],
    positions: Array,
    quaternions: Array,
) -> None:
    """Send the poses of all moving bodies over T moments.

    Args:
        stream: Where to.
        model: Compiled model that :func:`log_model` has logged.
        indexes: The moments on each timeline.
        positions: World positions of all bodies, shape (T, nbody, 3), in [m].
        quaternions: World orientations, wxyz, shape (T, nbody, 4).
    """
    xyzw = np.roll(quaternions, -1, axis=-1)
    for body in moving_bodies(model):
        columns = rr.Transform3D.columns(
            translation=positions[:, body], quaternion=xyzw[:, body]
        )
        stream.send_columns(body_path(model, body), indexes, columns)


def _entity_name(name: str) -> str:
    return name.strip("/").replace("/", ".")
