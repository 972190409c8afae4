"""The command line with short chains, for tests of what a run does and writes."""

import contextlib
import csv
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from unittest.mock import patch

from tablesetting import cli
from tablesetting.experiments import setup
from tablesetting.reward.config import DEFAULT, PRESETS

# Too short to mix: nothing is certified, and there is no finite bound.
_SHORT = replace(
    DEFAULT.mcmc,
    num_steps=1200,
    burn_in=200,
    num_particles=16,
    num_samples=200,
    target_ess=None,
)
QUICK = replace(DEFAULT, mcmc=_SHORT)
# Long enough for that; a lower target would hardly be sooner.
MIXED = DEFAULT
SMALL = ("--num-candidates", "6", "--num-layouts", "12")


@contextlib.contextmanager
def short_chains(preset=QUICK) -> Iterator[None]:
    """Let another preset be the default, its chains too, which options would lengthen."""
    with (
        patch.dict(PRESETS, default=preset),
        patch.object(setup, "_sampler", lambda chosen, _: chosen.mcmc),
    ):
        yield


def main(arguments: Sequence[str], preset=QUICK) -> int:
    """Run a command, with another default preset; returns its exit code."""
    with short_chains(preset):
        return cli.main(arguments)


def start(out, *options, task="vase", preset=QUICK):
    """Carry out a run with few candidates and test layouts; returns its exit code."""
    return main(["run", task, "--out", str(out), *SMALL, *options], preset)


def rows_of(folder, name="rounds.csv"):
    """Read a table of a run, every cell as text."""
    with (folder / name).open(newline="") as file:
        return list(csv.DictReader(file))


def without_seconds(rows):
    """Leave out of rows what no two runs have in common."""
    return [
        {name: cell for name, cell in row.items() if not name.endswith("_seconds")}
        for row in rows
    ]


def content_of(folder, name):
    """Read a JSON file of a run."""
    return json.loads((folder / name).read_text())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
