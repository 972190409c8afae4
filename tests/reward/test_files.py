import json
import math
import re
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tablesetting.errors import InvalidFile
from tablesetting.reward.demonstration_table import columns_of
from tablesetting.reward.files import (
    LAYOUTS_FORMAT,
    demonstrations_to_json,
    layout_to_json,
    read_demonstrations,
    read_layouts,
    read_weights,
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


WEIGHTS = weights_to_json(VASE.true_weights, VASE, RbfWidths())
DEMOS = demonstrations_to_json(
    [Demonstration(np.full((4, 2), 0.5), np.array([0.25, 1.0]))] * 2, VASE
)


def changed(content, path, value):
    """Change one value somewhere inside a file's content."""
    content = json.loads(json.dumps(content))
    inner = content
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return content


def test_weights_come_back_scaled_and_in_the_order_of_the_task(tmp_path):
    found = read_weights(write(tmp_path / "weights.json", WEIGHTS))
    assert (found.task, found.widths) == (VASE, RbfWidths())
    np.testing.assert_allclose(found.weights, VASE.true_weights, atol=1e-15)
    backwards = {
        "objects": list(VASE.objects[::-1]),
        "object_weights": [4e299, 3e299, 2e299, 1e299],
        "table_weights": [0] * 9,
    }
    found = read_weights(write(tmp_path / "weights.json", WEIGHTS | backwards))
    expected = [0.1, 0.2, 0.3, 0.4, *np.zeros(9)]
    np.testing.assert_allclose(found.weights, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("path", "value", "parts"),
    [
        (["format"], "tablesetting-weights/2", ["tablesetting-weights/2"]),
        (["task"], "cup", ["'cup'", "vase"]),
        (["task"], ["vase"], ["['vase']", "vase"]),
        (["objects"], ["plate", "bowl", "glass", "fork"], ["fork", "cup"]),
        (["objects"], "plate", ["`objects`"]),
        (["object_weights"], [0.1] * 3, ["`object_weights`", "4 numbers"]),
        (["object_weights", 1], math.nan, ["`object_weights`", "nan"]),
        (["table_weights", 8], math.inf, ["`table_weights`", "inf"]),
        (["table_weights", 8], True, ["`table_weights`", "True"]),
        (["table_weights", 8], 10**400, ["`table_weights`", "finite"]),
        (["object_width"], 0.0, ["`object_width`", "0.05"]),
        (["table_width"], None, ["`table_width`", "None"]),
    ],
)
def test_a_bad_value_among_weights_is_named(tmp_path, path, value, parts):
    file = write(tmp_path / "weights.json", changed(WEIGHTS, path, value))
    with pytest.raises(InvalidFile) as caught:
        read_weights(file)
    assert all(part in str(caught.value) for part in ["weights.json", *parts])


def test_weights_that_prefer_nothing_are_refused(tmp_path):
    nothing = WEIGHTS | {"object_weights": [0] * 4, "table_weights": [0.0] * 9}
    with pytest.raises(InvalidFile, match="all weights are 0"):
        read_weights(write(tmp_path / "weights.json", nothing))


def test_demonstrations_come_back_from_json_and_from_a_table(tmp_path):
    rng = np.random.default_rng(0)
    demos = [Demonstration(rng.random((4, 2)), rng.random(2)) for _ in range(3)]
    json_file = write(tmp_path / "demos.json", demonstrations_to_json(demos, VASE))
    names = columns_of(VASE)
    order = rng.permutation(len(names))
    rows = [np.r_[demo.layout.ravel(), demo.placement].tolist() for demo in demos]
    table = tmp_path / "demos.CSV"
    lines = [[cells[k] for k in order] for cells in (names, *rows)]
    text = "\r\n".join(",".join(map(str, line)) for line in lines)
    table.write_text(f"\ufeff{text}\n\n", encoding="utf-8")
    for file in (json_file, table):
        task, found = read_demonstrations(file)
        assert task == VASE
        for demo, expected in zip(found, demos, strict=True):
            np.testing.assert_array_equal(demo.layout, expected.layout)
            np.testing.assert_array_equal(demo.placement, expected.placement)


@pytest.mark.parametrize(
    ("path", "value", "parts"),
    [
        (["demonstrations"], [], ["at least one"]),
        (["demonstrations", 1], [], ["demonstration 1", "`placement`"]),
        (["demonstrations", 1, "placement"], [0.5, 1.01], ["demonstration 1", "1.01"]),
        (["demonstrations", 1, "placement"], [math.nan, 0], ["demonstration 1", "nan"]),
        (["demonstrations", 0, "layout", "cup"], "x", ["demonstration 0", "'cup'"]),
        (["demonstrations", 0, "layout", "fork"], [0, 0], ["names 'fork'"]),
    ],
)
def test_a_bad_value_among_demonstrations_is_named(tmp_path, path, value, parts):
    file = write(tmp_path / "demos.json", changed(DEMOS, path, value))
    with pytest.raises(InvalidFile) as caught:
        read_demonstrations(file)
    assert all(part in str(caught.value) for part in ["demos.json", *parts])


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["lacks the column 'plate_x'", "plate_x,plate_y"]),
        ("plate_x,plate_y\n", ["lacks the column 'bowl_x'"]),
        (",".join(columns_of(VASE)), ["no rows"]),
        (",".join([*columns_of(VASE), "note"]), ["unknown column 'note'"]),
        (",".join([*columns_of(VASE), "cup_x"]), ["'cup_x' twice"]),
        (";".join(columns_of(VASE)), ["semicolons"]),
        (",".join(columns_of(VASE)) + "\n0.5,0.5\n", ["row 1", "2 cells"]),
        (",".join(columns_of(VASE)) + "\n" + ",".join("x" * 10), ["'x'", "plate"]),
        (",".join(columns_of(VASE)) + "\n" + ",".join(["nan"] * 10), ["nan", "plate"]),
        ('"', ["cannot read"]),
    ],
)
def test_a_bad_table_of_demonstrations_is_named(tmp_path, text, parts):
    file = tmp_path / "demos.csv"
    file.write_text(text)
    with pytest.raises(InvalidFile) as caught:
        read_demonstrations(file)
    assert all(part in str(caught.value) for part in ["demos.csv", *parts])
