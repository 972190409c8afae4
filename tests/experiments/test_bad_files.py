"""Files that are damaged in many ways: refused in one line, or read right."""

import json
import re

import numpy as np
import pytest

from tablesetting import cli
from tablesetting.errors import InvalidFile, TableSettingError
from tablesetting.experiments.config import LearnConfig
from tablesetting.experiments.learn import read_settings
from tablesetting.options import to_options
from tablesetting.results import CONFIG, CONFIG_FORMAT, package_versions
from tablesetting.reward.files import (
    demonstrations_to_json,
    read_demonstrations,
    read_layouts,
    read_weights,
    weights_to_json,
)
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import VASE

NUM_MUTATIONS = 1000
STRANGE = (
    *("null", "true", "NaN", "Infinity", "-Infinity", "1e999", "-1e308", "1e-320"),
    *(
        "9" * 400,
        "9" * 5000,
        "0x10",
        "[]",
        "{}",
        '""',
        '"plate"',
        '"\\ud800"',
        '"τραπέζι"',
    ),
    *(
        '"' + "x" * 100_000 + '"',
        "[" * 3000 + "]" * 3000,
        "[" * 200_000,
        "-0.0",
        "1.0e0",
    ),
)
TOKEN = re.compile(r'"[^"]*"|-?[0-9][-+.eE0-9]*|[\[\]{}:,]')


def mutate(text, rng):
    """Damage a JSON text in one of the ways in which files are damaged."""
    kind = rng.integers(6)
    if kind == 0:
        return text[: rng.integers(len(text))]
    tokens = list(TOKEN.finditer(text))
    chosen = tokens[rng.integers(len(tokens))]
    start, end = chosen.span()
    if kind <= 2:
        return text[:start] + STRANGE[rng.integers(len(STRANGE))] + text[end:]
    if kind == 3:
        return text[:start] + text[end:]
    if kind == 4:  # Twice, as a name may be.
        return f"{text[:end]},{text[start:]}"
    other = tokens[rng.integers(len(tokens))]
    return text[:start] + other[0] + text[end:]


def check_weights(path):
    found = read_weights(path)
    assert np.abs(found.weights).sum() == pytest.approx(1.0)


def check_demonstrations(path):
    for demo in read_demonstrations(path)[1]:
        places = np.vstack([demo.layout, demo.placement])
        assert places.shape == (5, 2)
        assert ((places >= 0.0) & (places <= 1.0)).all()


def check_config(path):
    config = read_settings(path.parent)
    assert isinstance(config, LearnConfig)
    assert isinstance(config.seed, int)


LAYOUT = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
DEMOS = [Demonstration(LAYOUT, np.array([0.5, 0.5]))] * 2
FILES = {
    "weights.json": (
        weights_to_json(VASE.true_weights, VASE, RbfWidths()),
        check_weights,
    ),
    "demonstrations.json": (demonstrations_to_json(DEMOS, VASE), check_demonstrations),
    CONFIG: (
        {
            "format": CONFIG_FORMAT,
            "command": "learn",
            "options": to_options(LearnConfig("demos.json"), ("out", "append")),
            "resolved": {"task": "vase"},
            "versions": package_versions(),
        },
        check_config,
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_refused_or_read_right(name, tmp_path):
    content, check = FILES[name]
    text, path = json.dumps(content, indent=1), tmp_path / name
    rng, refusals = np.random.default_rng(0), list[str]()
    for _ in range(NUM_MUTATIONS):
        path.write_text(mutate(text, rng), encoding="utf-8", errors="surrogatepass")
        try:
            check(path)
        except InvalidFile as error:
            refusals.append(str(error))
    assert not any("\n" in message or len(message) > 600 for message in refusals)
    assert NUM_MUTATIONS / 2 < len(refusals) < NUM_MUTATIONS


@pytest.mark.parametrize("junk", [b"", b"\x00", b"\xff\xfe{}", b"\x89PNG\r\n", b"[1]"])
@pytest.mark.parametrize("name", FILES)
def test_what_is_no_json_is_refused(name, junk, tmp_path):
    path = tmp_path / name
    path.write_bytes(junk)
    with pytest.raises(TableSettingError, match=name.split(".")[0]):
        FILES[name][1](path)
    with pytest.raises(TableSettingError):
        read_layouts(path, VASE.objects)


def test_a_command_says_so_in_one_line_and_leaves_no_folder(tmp_path, capsys):
    rng, out = np.random.default_rng(1), tmp_path / "out"
    for name, command in (
        ("weights.json", "validate"),
        ("demonstrations.json", "learn"),
    ):
        path, text = tmp_path / name, json.dumps(FILES[name][0])
        for _ in range(25):
            path.write_text(mutate(text, rng), encoding="utf-8", errors="surrogatepass")
            try:
                FILES[name][1](path)
            except InvalidFile:
                assert cli.main([command, str(path), "--out", str(out)]) == 2
                error = capsys.readouterr().err
                assert error.startswith("error: ")
                assert error.count("\n") == 1
                assert not out.exists()
