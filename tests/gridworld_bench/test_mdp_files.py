import json

import numpy as np
import pytest
from worlds import KINDS, mixed_evidence, small_world

from gridworld_bench.files import (
    read_demonstrations,
    read_world,
    save_demonstrations,
    save_world,
)
from tablesetting.errors import InvalidFile


@pytest.mark.parametrize("kind", KINDS)
def test_a_world_comes_back_as_it_was(kind, tmp_path):
    mdp, weights = small_world(kind)
    save_world(tmp_path / "world.json", mdp, weights)
    found, wanted = read_world(tmp_path / "world.json")
    np.testing.assert_array_equal(wanted, weights)
    for name in ("successors", "probabilities", "features", "initial_states"):
        np.testing.assert_array_equal(getattr(found, name), getattr(mdp, name))
    np.testing.assert_array_equal(found.is_terminal, mdp.is_terminal)
    assert found.discount == mdp.discount
    save_world(tmp_path / "world.json", mdp)
    assert read_world(tmp_path / "world.json")[1] is None


def test_demonstrations_come_back_as_they_were(tmp_path):
    mdp, weights = small_world("grid")
    evidence = mixed_evidence(mdp, weights)
    save_demonstrations(tmp_path / "demos.json", evidence)
    found = read_demonstrations(tmp_path / "demos.json", mdp)
    for name in ("states", "actions", "is_good"):
        np.testing.assert_array_equal(getattr(found, name), getattr(evidence, name))


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"format": "other"}, "format"),
        ({"features": None}, "features"),
        ({"features": [[1.0], [1.0, 2.0]]}, "features"),
        ({"features": [["a"]] * 16}, "features"),
        ({"successors": [[[0.5]]]}, "successors"),
        ({"successors": [[[99]] * 4] * 16}, "below 16"),
        ({"discount": 1.0}, "discount"),
        ({"discount": None}, "discount"),
        ({"discount": 10**400}, "too large"),
        ({"features": [[]] * 16}, "at least one"),
        ({"initial_states": []}, "at least one"),
        ({"terminal_states": [16]}, "below 16"),
        ({"true_weights": [1.0]}, "6 finite numbers"),
    ],
)
def test_a_bad_world_is_named(change, part, tmp_path):
    path = tmp_path / "world.json"
    save_world(path, *small_world("grid"))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InvalidFile, match=part):
        read_world(path)


@pytest.mark.parametrize(
    ("pairs", "part"),
    [
        ([], "at least one"),
        ([[1, 2]], "pair 0"),
        ([{"state": 16, "action": 0, "is_good": True}], "state 16"),
        ([{"state": 0, "action": True, "is_good": True}], "action True"),
        ([{"state": 0, "action": 0, "is_good": 1}], "is_good"),
    ],
)
def test_a_bad_demonstration_is_named(pairs, part, tmp_path):
    path = tmp_path / "demos.json"
    content = {"format": "gridworld-demonstrations/1", "pairs": pairs}
    path.write_text(json.dumps(content))
    with pytest.raises(InvalidFile, match=part):
        read_demonstrations(path, small_world("grid")[0])
