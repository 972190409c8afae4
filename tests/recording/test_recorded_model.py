from pathlib import Path

import mujoco
import numpy as np
import pytest
from sample_run import episode

from tablesetting.recording.entities import BODIES
from tablesetting.recording.geometry import body_path, drawn_geoms, moving_bodies
from tablesetting.recording.reading import Recording
from tablesetting.recording.shapes import geom_rgba, geom_shape

_TRANSLATION = "Transform3D:translation"
_QUATERNION = "Transform3D:quaternion"
_GEOM_TRANSLATION = "InstancePoses3D:translations"
_GEOM_QUATERNION = "InstancePoses3D:quaternions"


def names(model: mujoco.MjModel, geoms: list[int]) -> list[str]:
    return [model.geom(geom).name for geom in geoms]


def turn(point: np.ndarray, xyzw: np.ndarray) -> np.ndarray:
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, np.asarray(point, float), np.roll(xyzw, 1))
    return turned


def test_collision_shapes_are_drawn_only_where_there_is_nothing_else(model):
    assert names(model, drawn_geoms(model, model.body("stand/link").id)) == ["bone"]
    assert names(model, drawn_geoms(model, model.body("cup").id)) == ["cup_hull"]


def test_bodies_are_siblings_whatever_their_names(model):
    paths = [body_path(model, body) for body in range(model.nbody)]
    assert paths[2] == f"{BODIES}/stand.link"
    assert all(path.count("/") == BODIES.count("/") + 1 for path in paths)
    assert len(set(paths)) == model.nbody


def test_only_bodies_with_a_joint_above_them_move(model):
    moving = [model.body(body).name for body in moving_bodies(model)]
    assert moving == ["stand/link", "tip", "cup"]


def test_a_geom_left_grey_takes_the_colour_of_its_material(model):
    np.testing.assert_equal(geom_rgba(model, model.geom("wedge").id), [0, 0, 1, 1])
    np.testing.assert_equal(geom_rgba(model, model.geom("stand/foot").id), [1, 0, 0, 1])


def test_a_capsule_reaches_from_end_to_end(model):
    shape, pose = geom_shape(model, model.geom("bone").id)
    (length,) = shape.lengths.as_arrow_array().to_pylist()
    (start,) = pose.translations.as_arrow_array().to_pylist()
    (quaternion,) = pose.quaternions.as_arrow_array().to_pylist()
    end = start + turn([0.0, 0.0, length], np.array(quaternion))
    ends = sorted([list(start), list(end)])
    np.testing.assert_allclose(ends, [[0, 0, 0], [0.2, 0, 0.1]], atol=1e-6)


def test_a_height_field_is_refused():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1"/></asset>'
        '<worldbody><geom type="hfield" hfield="hills"/></worldbody></mujoco>'
    )
    with pytest.raises(ValueError, match="mjGEOM_HFIELD cannot be recorded"):
        geom_shape(model, 0)


def test_a_mesh_keeps_its_triangles_and_normals(model, recorded: Path):
    path = f"{body_path(model, model.body('tip').id)}/wedge"
    recording = Recording(recorded)
    read = {
        part: np.array(recording.rows(path, f"Mesh3D:{part}")[0].values)
        for part in ("vertex_positions", "vertex_normals", "triangle_indices")
    }
    corners = read["vertex_positions"][read["triangle_indices"]]
    np.testing.assert_allclose(corners, model.mesh_vert[model.mesh_face], atol=1e-7)
    normals = read["vertex_normals"][read["triangle_indices"]]
    np.testing.assert_allclose(
        normals, model.mesh_normal[model.mesh_facenormal], atol=1e-7
    )


def test_every_pose_in_the_file_is_the_models(model, recorded: Path):
    recording = Recording(recorded)
    frames = list(episode(model))
    for body in moving_bodies(model):
        path = body_path(model, body)
        positions = [row.value for row in recording.rows(path, _TRANSLATION)]
        turns = [row.value for row in recording.rows(path, _QUATERNION)]
        first = np.array(positions[: len(frames)])
        expected = np.array([frame.positions[body] for frame in frames])
        np.testing.assert_allclose(first, expected, atol=1e-6)
        expected = np.array([frame.quaternions[body] for frame in frames])
        actual = np.roll(turns[: len(frames)], 1, axis=1)
        np.testing.assert_allclose(actual, expected, atol=1e-6)


def test_geoms_rebuilt_from_the_file_stand_where_the_model_has_them(
    model, recorded: Path
):
    recording = Recording(recorded)
    *_, last = episode(model)
    data = mujoco.MjData(model)
    data.qvel[:] = np.linspace(-1.0, 1.0, model.nv)
    for _ in range(10):
        mujoco.mj_step(model, data, 10)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_equal(last.positions, data.xpos)
    for name in ("stand/foot", "ball", "egg", "wedge", "cup_hull"):
        geom = model.geom(name)
        path = body_path(model, int(geom.bodyid[0]))
        entity = f"{path}/{name.replace('/', '.')}"
        position = recording.rows(path, _TRANSLATION)[-1].value
        quaternion = recording.rows(path, _QUATERNION)[-1].value
        offset = recording.rows(entity, _GEOM_TRANSLATION)[0].value
        rebuilt = position + turn(offset, np.array(quaternion))
        np.testing.assert_allclose(rebuilt, data.geom_xpos[geom.id], atol=1e-6)
