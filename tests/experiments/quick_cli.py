"""The command line with short chains, for tests of what a run does and writes."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from unittest.mock import patch

from tablesetting import cli
from tablesetting.reward.problem import DEFAULT, PRESETS

_SHORT = replace(DEFAULT.mcmc, num_steps=1500, burn_in=500, thin=20)
QUICK = replace(DEFAULT, mcmc=_SHORT)


def main(arguments: Sequence[str]) -> int:
    """Run a command; returns its exit code."""
    with patch.dict(PRESETS, default=QUICK):
        return cli.main(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
