"""Repeat a run under many seeds and sum up how well it learned and placed.

`python benchmarks/seeds.py vase --seeds 10 --out DIR [options of tablesetting run]`
"""

import argparse
import contextlib
import io
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tablesetting import cli
from tablesetting.experiments.certificate import CERTIFICATE_FORMAT
from tablesetting.results import ROUNDS, numbers, read_json, read_rows


def main() -> int:
    """Run all seeds anew; print the summary."""
    options, run_options = _parse_options()
    rows, last_rows, num_certified = [], [], 0
    for seed in range(options.seeds):
        folder = options.out / f"{options.task}-{seed}"
        _run(options.task, seed, folder, run_options)
        found = read_rows(folder / ROUNDS)
        rows += found
        last_rows.append(found[-1])
        certificate = read_json(folder / "certificate.json", CERTIFICATE_FORMAT)
        num_certified += certificate["certified"]
    _print_learning(last_rows)
    _print_trust(rows, num_certified, len(last_rows))
    _print_executions([row for row in rows if row["commanded_x"]])
    return 0


def _parse_options() -> tuple[argparse.Namespace, list[str]]:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=("vase", "spoon"))
    parser.add_argument("--seeds", type=int, default=10, help="seeds 0 to N - 1")
    parser.add_argument("--out", type=Path, required=True, help="folder of all runs")
    return parser.parse_known_args()


def _run(task: str, seed: int, folder: Path, options: list[str]) -> None:
    argv = ["run", task, "--seed", str(seed), "--out", str(folder), "--overwrite"]
    with contextlib.redirect_stdout(io.StringIO()):
        code = cli.main([*argv, *options])
    if code:
        sys.exit(code)


def _print_learning(rows: Sequence[Mapping[str, str]]) -> None:
    most = max(int(row["num_demos"]) for row in rows)
    print(f"{len(rows)} runs, after {most} demonstrations or fewer:")
    for column in (
        *("mean_placement_error", "max_placement_error"),
        *("var_bound", "deployment_bound", "num_demos"),
    ):
        values = np.array(numbers(rows, column))
        error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
        print(f"  {column:<24}{values.mean():.4f} +- {error:.4f} (standard error)")


def _print_trust(
    rows: Sequence[Mapping[str, str]], num_certified: int, num_runs: int
) -> None:
    print(f"{num_certified} of {num_runs} runs certified")
    print(f"  effective sample size {min(numbers(rows, 'ess')):.0f} at least")
    print(f"  R-hat {max(numbers(rows, 'rhat')):.4f} at most")


def _print_executions(rows: Sequence[Mapping[str, str]]) -> None:
    made = [row for row in rows if row["settled_x"]]
    good = [row for row in made if row["success"] == "True"]
    print(f"{len(rows)} placements commanded, {len(rows) - len(made)} refused")
    print(f"  {'succeeded':<24}{len(good)} of {len(made)}")
    for column in (
        *("execution_error_mm", "tilt_deg", "bystander_shift_mm"),
        *("detour", "outcome_error"),
    ):
        # In a receptacle, a tilt is no error and is not given.
        values = [value for value in numbers(made, column) if np.isfinite(value)]
        if values:
            quantiles = np.quantile(values, (0.5, 0.95, 1.0))
            median, high, largest = (f"{value:.3f}" for value in quantiles)
            print(f"  {column:<24}median {median}, 95 % {high}, largest {largest}")
    for row in rows:
        if row["failure"]:
            print(f"  failure: {row['failure']}")


if __name__ == "__main__":
    sys.exit(main())
