import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tablesetting.errors import InvalidLayout
from tablesetting.reward.footprint import POINT, Footprint
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import FOOTPRINTS, RECEPTACLE_RADIUS, SPOON, TASKS, VASE

VASES = LayoutSpace.of_task(VASE, are_points=False)
SPOONS = LayoutSpace.of_task(SPOON, are_points=False)
POINTS = LayoutSpace.of_task(VASE, are_points=True)
GOOD = np.array([[0.2, 0.3], [0.7, 0.7], [0.2, 0.75], [0.75, 0.25]])


def changed(row, position):
    """Return the good layout of the vase with one object elsewhere."""
    layout = GOOD.copy()
    layout[row] = position
    return layout


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        (GOOD[:3], "shape (3, 2); give one (x, y) for each of plate, bowl, glass, cup"),
        (GOOD.ravel(), "shape (8,)"),
        (changed(1, (1.01, 0.7)), "'bowl' is off the table at (1.010, 0.700); both"),
        (changed(2, (0.2, -0.1)), "'glass' is off the table at (0.200, -0.100)"),
        (changed(3, (np.nan, 0.5)), "'cup' is off the table at (nan, 0.500)"),
        (changed(3, (np.inf, 0.5)), "'cup' is off the table at (inf, 0.500)"),
        (
            changed(2, (0.2, 0.5)),
            "'plate' at (0.200, 0.300) and 'glass' at (0.200, 0.500) are too close; "
            "move them apart by 0.078 table units or more",
        ),
    ],
)
def test_a_layout_that_cannot_be_set_up_is_refused(layout, message):
    with pytest.raises(InvalidLayout, match=re.escape(message)):
        VASES.check(layout)


def test_a_layout_that_leaves_the_item_no_room_is_refused():
    crowded = replace(VASES, item=Footprint(0.5))
    with pytest.raises(InvalidLayout, match="item fits nowhere among the objects"):
        crowded.check(GOOD)
    assert not crowded.has_room(GOOD)
    assert VASES.has_room(GOOD)


def test_a_receptacle_is_room_for_the_item_but_makes_no_layout_valid():
    layout = SPOONS.sample(1, rng=np.random.default_rng(0))[0]
    crowded = replace(SPOONS, item=Footprint(0.5))
    inside = crowded.free_space(layout, SPOON.receptacles)
    assert inside.contains(layout).tolist() == [True] + 5 * [False]
    rim = layout[0] + RECEPTACLE_RADIUS * np.array([[0.0, 0.99], [0.0, 1.01]])
    assert inside.contains(rim).tolist() == [True, False]
    assert not crowded.has_room(layout)


def test_layouts_that_hardly_exist_are_given_up_on_with_a_message():
    crowded = replace(VASES, footprints=(Footprint(0.5),) * 4)
    with pytest.raises(InvalidLayout, match="plate, bowl, glass, cup hardly fit"):
        crowded.sample(1, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    "layout", [GOOD, GOOD[[0, 0, 0, 0]], GOOD.round()], ids=["good", "heap", "edge"]
)
def test_points_may_stand_anywhere_on_the_table(layout):
    POINTS.check(layout)


def test_sizes_are_those_of_the_objects_or_none():
    assert VASES.footprints == tuple(FOOTPRINTS[name] for name in VASE.objects)
    assert VASES.item == FOOTPRINTS["vase"]
    assert POINTS.footprints == (POINT,) * 4
    assert POINTS.item == POINT


def test_two_objects_touch_at_the_sum_of_their_radii_and_the_least_gap():
    plate, bowl = FOOTPRINTS["plate"].radius, FOOTPRINTS["bowl"].radius
    touching = plate + bowl + 0.03
    for gap, is_apart in ((1e-9, True), (-1e-9, False)):
        layout = [[0.2, 0.2], [0.2 + touching + gap, 0.2], [0.1, 0.9], [0.9, 0.9]]
        assert VASES.are_apart(np.array([layout])).tolist() == [is_apart]


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32), st.sampled_from([VASES, SPOONS, POINTS]))
def test_sampled_layouts_can_be_set_up(seed, space):
    rng = np.random.default_rng(seed)
    layouts = space.sample(20, rng=rng)
    assert layouts.shape == (20, len(space.objects), 2)
    for layout in layouts:
        space.check(layout)
    for layout in space.sample_one_moved(layouts[0], 20, rng=rng):
        space.check(layout)


@pytest.mark.parametrize("space", [VASES, SPOONS, POINTS])
def test_exactly_one_object_is_moved_and_each_at_times(space):
    rng = np.random.default_rng(0)
    layout = space.sample(1, rng=rng)[0]
    before = layout.copy()
    moved = space.sample_one_moved(layout, 300, rng=rng)
    is_moved = (moved != layout).any(axis=2)
    assert (is_moved.sum(axis=1) == 1).all()
    assert is_moved.any(axis=0).all()
    np.testing.assert_array_equal(layout, before)


def test_check_and_the_fast_test_for_overlap_agree():
    layouts = np.random.default_rng(0).random((500, 4, 2))
    apart = VASES.are_apart(layouts)
    assert 0 < apart.sum() < 500
    for layout, is_apart in zip(layouts, apart, strict=True):
        if is_apart:
            VASES.check(layout)
        else:
            with pytest.raises(InvalidLayout, match="too close"):
                VASES.check(layout)


def test_points_are_uniform_on_the_table():
    layouts = POINTS.sample(20_000, rng=np.random.default_rng(0))
    np.testing.assert_allclose(layouts.mean(axis=0), 0.5, atol=0.01)
    np.testing.assert_allclose(layouts.var(axis=0), 1 / 12, atol=0.003)
    flat = layouts.reshape(-1, 8)
    np.testing.assert_allclose(np.corrcoef(flat.T), np.eye(8), atol=0.03)


def test_the_moved_object_is_uniform_on_the_table_and_chosen_evenly():
    moved = POINTS.sample_one_moved(GOOD, 20_000, rng=np.random.default_rng(0))
    is_moved = (moved != GOOD).any(axis=2)
    np.testing.assert_allclose(is_moved.mean(axis=0), 0.25, atol=0.015)
    np.testing.assert_allclose(moved[is_moved].mean(axis=0), 0.5, atol=0.01)
    np.testing.assert_allclose(moved[is_moved].var(axis=0), 1 / 12, atol=0.003)


def test_same_seed_draws_the_same_layouts_however_many():
    few, many = (SPOONS.sample(n, rng=np.random.default_rng(3)) for n in (3, 30))
    np.testing.assert_array_equal(few, many[:3])


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_item_fits_only_at_its_clearance_from_every_object(task):
    space = LayoutSpace.of_task(task, are_points=False)
    rng = np.random.default_rng(0)
    layout, points = space.sample(1, rng=rng)[0], rng.random((2000, 2))
    item = FOOTPRINTS[task.item]
    gaps = [
        FOOTPRINTS[name].grow(item, 0.0).distance(points - center)
        for name, center in zip(task.objects, layout, strict=True)
    ]
    fits = np.min(gaps, axis=0) >= task.clearance
    assert 0 < fits.sum() < len(points)
    np.testing.assert_array_equal(space.free_space(layout).contains(points), fits)


def test_points_are_in_nobodys_way():
    assert POINTS.free_space(GOOD).contains(GOOD).all()


def test_outlines_surround_things_and_mark_points():
    for name, outline in VASES.outlines(GOOD).items():
        center = GOOD[VASE.objects.index(name)]
        distance = FOOTPRINTS[name].distance(outline - center)
        np.testing.assert_allclose(distance, 0.0, atol=1e-12)
        np.testing.assert_allclose(outline[0], outline[-1], atol=1e-12)
    for outline, center in zip(POINTS.outlines(GOOD).values(), GOOD, strict=True):
        np.testing.assert_array_equal(outline, [center])
