"""The paper's experiments in grid worlds, a command each."""

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import cast

from gridworld_bench.experiments.config import CONFIGS, StudyConfig
from gridworld_bench.experiments.driving_config import (
    DRIVING_CONFIGS,
    DriveConfig,
    DrivingConfig,
)
from tablesetting.command_line import (
    follow_trials,
    new_folder,
    num_cores,
    parse,
    resume_advice,
    run_command,
    telling_why_it_stops,
)

# The matrices are small: a second thread would only spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: Arguments after the program's name; those of the process if None.

    Returns:
        The exit code: 0, 1 (the work failed), 2 (bad input) or 130 (interrupted).
    """

    def command() -> int:
        arguments = list(sys.argv[1:] if argv is None else argv)
        configs = CONFIGS | DRIVING_CONFIGS
        config = parse(
            arguments, configs, prog="gridworld-bench", description=__doc__ or ""
        )
        if isinstance(config, DriveConfig):
            return _drive(config)
        if isinstance(config, DrivingConfig):
            return _driving(config)
        return _study(cast(StudyConfig, config))

    return run_command(command)


def _drive(config: DriveConfig) -> int:
    from gridworld_bench.experiments.drive import record_drive

    print(*record_drive(config), sep="\n")
    return 0


def _driving(config: DrivingConfig) -> int:
    from gridworld_bench.experiments.driving import learn_driving

    out = config.out or new_folder(Path("runs", "grid"), "driving")
    print(*learn_driving(config, out), sep="\n")
    return 0


def _study(config: StudyConfig) -> int:
    from gridworld_bench.experiments.findings import finish
    from gridworld_bench.experiments.study import Study
    from gridworld_bench.experiments.trials import load_kernels

    out = config.out or new_folder(Path("runs", "grid"), config.name)
    with Study.open(config, out) as study:
        num_before = len(study.rows)
        num_trials = num_before + len(study.unfinished)

        def progress() -> str:
            return (
                f"{len(study.rows)} of {num_trials} trials are in "
                f"{shlex.quote(str(out))}; {resume_advice(out)}"
            )

        with telling_why_it_stops(progress):
            if study.unfinished:
                load_kernels()  # Lest every process compile them.
            trials = study.run(config.jobs or num_cores())
            follow_trials(trials, num_before, num_trials)
            lines = finish(study)
    print(*lines, sep="\n")
    return 0
