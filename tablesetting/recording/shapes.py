"""MuJoCo geoms as Rerun shapes, in the frame of their body."""

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import rerun as rr

from tablesetting.irl.arrays import Array

_SOLID = rr.components.FillMode.Solid
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)  # A geom left at this takes its material's colour.
_PLANE_THICKNESS = 1e-3  # [m]
_INFINITE_PLANE = 2.0  # Half extent that stands for "no end", in [m].

Shape = tuple[rr.AsComponents, rr.InstancePoses3D]


def geom_shape(model: mujoco.MjModel, geom: int) -> Shape:
    """Build the archetypes that draw one geom.

    Args:
        model: Compiled model.
        geom: Index of the geom.

    Returns:
        The shape around its own origin, and its pose in the frame of the body.

    Raises:
        ValueError: If the geom is a height field or a signed distance field.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    rgba, offset = geom_rgba(model, geom), np.zeros(3)
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        return _mesh(model, int(model.geom_dataid[geom]), rgba), _pose(model, geom)
    if kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
        size = np.where(size > 0.0, size, _INFINITE_PLANE)
        size = np.array([*size[:2], _PLANE_THICKNESS])
        offset[2] = -_PLANE_THICKNESS  # The plane is the upper face.
    if kind == int(mujoco.mjtGeom.mjGEOM_CAPSULE):
        offset[2] = -size[1]  # Rerun's capsule starts at the centre of one end.
    return _primitive(kind, size, rgba), _pose(model, geom, offset)


def geom_rgba(model: mujoco.MjModel, geom: int) -> npt.NDArray[np.float32]:
    """Colour a geom as MuJoCo does: its own, else its material's, shape (4,)."""
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.allclose(rgba, _DEFAULT_RGBA):
        rgba = model.mat_rgba[material]
    return np.asarray(rgba, dtype=np.float32)


def _primitive(
    kind: int, size: Array, rgba: npt.NDArray[np.float32]
) -> rr.AsComponents:
    types = mujoco.mjtGeom
    if kind == int(types.mjGEOM_SPHERE):
        half_sizes = np.repeat(size[0], 3)
        return rr.Ellipsoids3D(half_sizes=half_sizes, colors=rgba, fill_mode=_SOLID)
    if kind == int(types.mjGEOM_ELLIPSOID):
        return rr.Ellipsoids3D(half_sizes=size, colors=rgba, fill_mode=_SOLID)
    if kind in (int(types.mjGEOM_BOX), int(types.mjGEOM_PLANE)):
        return rr.Boxes3D(half_sizes=size, colors=rgba, fill_mode=_SOLID)
    if kind == int(types.mjGEOM_CYLINDER):
        return rr.Cylinders3D(
            lengths=2.0 * size[1], radii=size[0], colors=rgba, fill_mode=_SOLID
        )
    if kind == int(types.mjGEOM_CAPSULE):
        return rr.Capsules3D(
            lengths=2.0 * size[1], radii=size[0], colors=rgba, fill_mode=_SOLID
        )
    raise ValueError(f"geoms of type {types(kind).name} cannot be recorded")


def _mesh(model: mujoco.MjModel, mesh: int, rgba: npt.NDArray[np.float32]) -> rr.Mesh3D:
    vertices = _rows(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum, mesh)
    normals = _rows(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum, mesh)
    faces = _rows(model.mesh_face, model.mesh_faceadr, model.mesh_facenum, mesh)
    corners = _rows(model.mesh_facenormal, model.mesh_faceadr, model.mesh_facenum, mesh)
    # MuJoCo indexes vertices and normals apart, Rerun together: weld equal pairs.
    pairs = np.hstack([vertices[faces.ravel()], normals[corners.ravel()]])
    welded, triangles = np.unique(pairs, axis=0, return_inverse=True)
    return rr.Mesh3D(
        vertex_positions=welded[:, :3],
        vertex_normals=welded[:, 3:],
        triangle_indices=triangles.reshape(-1, 3),
        albedo_factor=rgba,
    )


def _rows(
    values: npt.NDArray[Any],
    starts: npt.NDArray[np.int32],
    counts: npt.NDArray[np.int32],
    mesh: int,
) -> npt.NDArray[Any]:
    """Take the rows of one mesh from an array of all meshes."""
    return values[starts[mesh] : starts[mesh] + counts[mesh]]


def _pose(
    model: mujoco.MjModel, geom: int, offset: Array | None = None
) -> rr.InstancePoses3D:
    position, quaternion = model.geom_pos[geom].copy(), model.geom_quat[geom]
    if offset is not None:
        turned = np.empty(3)
        mujoco.mju_rotVecQuat(turned, offset, quaternion)
        position += turned
    return rr.InstancePoses3D(
        translations=position, quaternions=np.roll(quaternion, -1)
    )
