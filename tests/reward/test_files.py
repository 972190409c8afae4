import json
import math
import re
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tablesetting.errors import InvalidFile
from tablesetting.reward.files import (
    LAYOUTS_FORMAT,
    demonstrations_to_json,
    layout_to_json,
    read_layouts,
    weights_to_json,
)
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import VASE

OBJECTS = ("plate", "cup")
ONE = {"plate": [0.25, 0.75], "cup": [0, 1]}

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9)
anything = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["plate", "cup", "fork"]), inner)
    ),
    max_leaves=8,
)


def write(path, content):
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def layouts_file(path, *layouts):
    return write(path, {"format": LAYOUTS_FORMAT, "layouts": list(layouts)})


def with_plate_at(position):
    return {"format": LAYOUTS_FORMAT, "layouts": [ONE, ONE | {"plate": position}]}


def test_layouts_come_back_in_the_order_of_the_objects(tmp_path):
    layouts = np.random.default_rng(0).random((5, 4, 2))
    path = layouts_file(
        tmp_path / "layouts.json",
        *(layout_to_json(layout, VASE.objects) for layout in layouts),
    )
    np.testing.assert_array_equal(read_layouts(path, VASE.objects), layouts)
    backwards = read_layouts(path, VASE.objects[::-1])
    np.testing.assert_array_equal(backwards, layouts[:, ::-1])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "has the format None; expected 'tablesetting-layouts/1'"),
        ({"layouts": [ONE]}, "has the format None"),
        (
            {"format": "tablesetting-layouts/2", "layouts": [ONE]},
            "has the format 'tablesetting-layouts/2'; expected 'tablesetting-layouts/1'",
        ),
        ({"format": LAYOUTS_FORMAT}, "`layouts` must be a list of at least one layout"),
        ({"format": LAYOUTS_FORMAT, "layouts": []}, "at least one layout"),
        ({"format": LAYOUTS_FORMAT, "layouts": ONE}, "must be a list"),
        (
            {"format": LAYOUTS_FORMAT, "layouts": [ONE, 3]},
            "layout 1 must map each object to [x, y]; got 3",
        ),
        (
            {"format": LAYOUTS_FORMAT, "layouts": [{"plate": [0, 0]}]},
            "layout 0 lacks 'cup'; it must place plate, cup",
        ),
        (
            {"format": LAYOUTS_FORMAT, "layouts": [ONE | {"fork": [0, 0]}]},
            "layout 0 names 'fork'; it must place plate, cup",
        ),
        (with_plate_at([0.5]), "layout 1, 'plate' is at [0.5]; give two numbers"),
        (with_plate_at([0.1, 0.2, 0.3]), "is at [0.1, 0.2, 0.3]"),
        (with_plate_at({"x": 0.5, "y": 0.5}), "is at {'x': 0.5, 'y': 0.5}"),
        (with_plate_at(None), "is at None"),
        (with_plate_at("ab"), "is at 'ab'"),
        (with_plate_at([0.5, "0.5"]), "is at [0.5, '0.5']"),
        (with_plate_at([0.5, True]), "is at [0.5, True]"),
        (with_plate_at([0.5, 1.001]), "is at [0.5, 1.001]; give two numbers in [0, 1]"),
        (with_plate_at([-0.1, 0.5]), "is at [-0.1, 0.5]"),
        (with_plate_at([math.nan, 0.5]), "is at [nan, 0.5]"),
        (with_plate_at([0.5, math.inf]), "is at [0.5, inf]"),
        (with_plate_at([10**400, 0]), "in [0, 1], in table units"),
    ],
)
def test_a_bad_file_is_refused_with_its_name_field_and_value(
    tmp_path, content, message
):
    path = write(tmp_path / "layouts.json", content)
    with pytest.raises(InvalidFile, match=re.escape(message)) as caught:
        read_layouts(path, OBJECTS)
    assert f"'{path}'" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe{}", b"[" * 100_000])
def test_what_is_not_json_is_refused(tmp_path, content):
    path = tmp_path / "layouts.json"
    path.write_bytes(content)
    with pytest.raises(InvalidFile, match=r"layouts\.json' is not valid JSON"):
        read_layouts(path, OBJECTS)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(InvalidFile, match="No such file or directory; check the path"):
        read_layouts(tmp_path / "nowhere.json", OBJECTS)
    with pytest.raises(InvalidFile, match="Is a directory"):
        read_layouts(tmp_path, OBJECTS)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "format": st.just(LAYOUTS_FORMAT) | anything,
            "layouts": st.lists(
                st.fixed_dictionaries({"plate": anything, "cup": anything}) | anything,
                max_size=2,
            )
            | anything,
        },
    )
    | anything
)
def test_a_file_is_read_or_refused_whatever_is_in_it(tmp_path, content):
    path = write(tmp_path / "layouts.json", content)
    with suppress(InvalidFile):
        layouts = read_layouts(path, OBJECTS)
        assert layouts.shape[1:] == (2, 2)
        assert ((layouts >= 0.0) & (layouts <= 1.0)).all()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_file_with_damaged_bytes_is_read_or_refused(tmp_path, data):
    path = layouts_file(tmp_path / "layouts.json", ONE, ONE)
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place : place + data.draw(st.integers(0, 3))] = data.draw(
        st.binary(max_size=3)
    )
    path.write_bytes(bytes(content))
    with suppress(InvalidFile):
        assert read_layouts(path, OBJECTS).shape[1:] == (2, 2)


def test_demonstrations_are_written_by_the_names_of_the_objects():
    layout = np.array(VASE.first_layout)
    demo = Demonstration(layout, np.array([0.5, 0.25]))
    content = demonstrations_to_json([demo, demo], VASE)
    assert content["format"] == "tablesetting-demonstrations/1"
    assert content["task"] == "vase"
    assert content["demonstrations"][1] == {
        "layout": dict(zip(VASE.objects, layout.tolist(), strict=True)),
        "placement": [0.5, 0.25],
    }
    assert json.loads(json.dumps(content)) == content


def test_weights_are_written_apart_for_objects_and_table():
    content = weights_to_json(VASE.true_weights, VASE, RbfWidths(0.2, 0.4))
    assert content == {
        "format": "tablesetting-weights/1",
        "task": "vase",
        "objects": ["plate", "bowl", "glass", "cup"],
        "object_weights": [-0.1] * 4,
        "table_weights": [0.0] * 4 + [0.6] + [0.0] * 4,
        "object_width": 0.2,
        "table_width": 0.4,
    }
    assert json.loads(json.dumps(content)) == content
