"""What a study found: a summary, the figure, and a comparison with the paper."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.curves import (
    Curve,
    Curves,
    Reach,
    average,
    paired_difference,
    reaches,
)
from tablesetting.experiments.comparison import compare
from tablesetting.experiments.config import LearningConfig
from tablesetting.experiments.published import Difference, differences, published_curves
from tablesetting.experiments.study_config import PlacementStudyConfig
from tablesetting.plotting import plot_placement_study
from tablesetting.results import SUMMARY, Row, RunFolder, numbers

COMPARISON = "comparison.md"
FIGURE = "figures/placement.png"

_QUANTITIES = (
    *("mean_placement_error", "max_placement_error", "var_bound", "bound_held"),
    *("test_var_bound", "test_bound_held"),
)
_LEVELS = (0.05, 0.02)  # Of the mean error, in table units.
_DIGITS = 6


def write_results(
    folder: RunFolder, config: PlacementStudyConfig, rows: Sequence[Row]
) -> list[str]:
    """Write summary, figure and comparison of a finished study.

    Args:
        folder: Where to.
        config: The settings.
        rows: All rows of rounds.csv.

    Returns:
        What to tell of it, in lines.
    """
    curves = average(rows, [name for name in _QUANTITIES if name in rows[0]])
    gains: dict[str, dict[str, Curve]] = {
        task: {
            strategy: paired_difference(rows, task, strategy, config.compared[0])
            for strategy in config.compared[1:]
        }
        for task in dict.fromkeys(key.task for key in curves)  # A shard may lack one.
    }
    title = _title(config)
    published = published_curves() if config.preset == "paper" else {}
    found = list(differences(curves, published)) if config.is_as_published else []
    reached = {
        task: [each for level in _LEVELS for each in reaches(rows, task, level)]
        for task in gains
    }
    text = compare(title, curves, found, gains, reached)
    folder.write(COMPARISON, lambda path: _save_text(path, text))
    figure = plot_placement_study(curves, published, title)
    for name in (FIGURE, FIGURE.replace(".png", ".svg")):
        folder.write(name, figure.savefig)
    folder.write_json(SUMMARY, _summarize(curves, found, reached, rows, config))
    return _tell(curves, found)


def _title(config: PlacementStudyConfig) -> str:
    """Name the settings that the figures depend on most."""
    settings = [
        f"{config.num_trials} trials",
        f"preset {config.preset}",
        f"seed {config.seed}",
    ]
    usual = PlacementStudyConfig()
    for name in ("candidates", "num_candidates", "layouts", "num_layouts"):
        if getattr(config, name) != getattr(usual, name):
            settings.append(f"{name.replace('_', ' ')} {getattr(config, name)}")
    for described in fields(LearningConfig):
        value = getattr(config.learning, described.name)
        if value != described.default:
            settings.append(f"{described.name.replace('_', ' ')} {value}")
    if config.shard:
        settings.append(f"shard {config.shard}")
    return ", ".join(settings)


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _summarize(
    curves: Curves,
    found: Sequence[Difference],
    reached: Mapping[str, Sequence[Reach]],
    rows: Sequence[Row],
    config: PlacementStudyConfig,
) -> dict[str, Any]:
    """Return the content of summary.json."""
    means = [
        {
            **key._asdict(),
            "num_trials": curve.num_trials,
            "num_demos": curve.num_demos.astype(int).tolist(),
            "mean": curve.means.round(_DIGITS).tolist(),
            "std": curve.stds.round(_DIGITS).tolist(),
        }
        for key, curve in curves.items()
    ]
    bars = [difference.bars for difference in found]
    return {
        "command": "study placement",
        "preset": config.preset,
        "seed": config.seed,
        "num_trials": config.num_trials,
        "shard": config.shard,
        "curves": means,
        "reached": [
            {"task": task} | asdict(each)
            for task, own in reached.items()
            for each in own
        ],
        "published": {
            "num_points": len(bars),
            "num_within_error_bars": sum(each.is_within_bar for each in found),
            "largest_distance_in_bars": round(max(bars, default=0.0), 3),
        },
        "seconds": {
            name: round(float(np.sum(numbers(rows, f"{name}_seconds"))), 3)
            for name in ("inference", "query")
        },
    }


def _tell(curves: Curves, found: Sequence[Difference]) -> list[str]:
    """Say in lines how well each strategy learned, and how near that is to the paper."""
    lines = []
    for (task, strategy, quantity), curve in curves.items():
        if quantity == "mean_placement_error":
            last = int(curve.num_demos[-1])
            spread = (
                f" +- {curve.standard_errors[-1]:.3f}" if curve.num_trials > 1 else ""
            )
            lines.append(
                f"{task}, {strategy}: mean error {curve.means[0]:.3f} after 1 "
                f"demonstration, {curve.means[-1]:.3f}{spread} after {last} "
                f"({curve.num_trials} trial{'s' * (curve.num_trials > 1)})"
            )
    if found:
        within = sum(difference.is_within_bar for difference in found)
        farthest = max(difference.bars for difference in found)
        lines.append(
            f"{within} of {len(found)} published points are within the published error "
            f"bars; the farthest is {farthest:.2f} bars off"
        )
    return lines
