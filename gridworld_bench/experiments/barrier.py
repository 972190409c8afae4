"""How many demonstrations it takes where few states tell anything."""

from collections.abc import Sequence

import numpy as np

from gridworld_bench.experiments.config import SparseBarrierConfig
from gridworld_bench.experiments.results import draw_means, losses_of
from gridworld_bench.experiments.study import Study
from tablesetting.bootstrap import estimate_ratio
from tablesetting.results import Row

_NO_LOSS = 1e-9
_PUBLISHED_RATIO = 3.45


def count_demonstrations(study: Study, rows: Sequence[Row]) -> list[str]:
    """Count demonstrations until the worst-case loss is small, strategy by strategy."""
    config = study.config
    assert isinstance(config, SparseBarrierConfig)
    worst = losses_of(rows, config, "max_policy_loss")
    needed = {name: _first_below(each, config.level) for name, each in worst.items()}
    baseline = needed["active-var"] if "active-var" in needed else None
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(0, 1)))
    lines = [
        f"# {config.name}: seed {config.seed}, preset {config.preset}, "
        f"{config.num_trials} trials",
        "",
        f"Demonstrations until the worst-case policy loss is below {config.level:g}; "
        f"trials that do not get there in {config.num_queries} queries count as if the "
        "next one had done it. Ratio to active-var, paired, with a 95 % interval; the "
        f"paper has {_PUBLISHED_RATIO} for random.",
        "",
        "| strategy | demonstrations | trials that never got there | ratio |",
        "|---|---|---|---|",
    ]
    found = {}
    for name, counts in needed.items():
        num_missed = int((counts > config.num_queries + 1).sum())
        ratio = None
        if baseline is not None and name != "active-var":
            ratio = estimate_ratio(counts, baseline, rng=rng)
        lines.append(f"| {name} | {counts.mean():.1f} | {num_missed} | {ratio or ''} |")
        found[name] = {
            "mean_demonstrations": float(counts.mean()),
            "num_missed": num_missed,
            "ratio_to_active_var": None if ratio is None else vars(ratio),
            "share_with_loss": (losses_of(rows, config)[name] > _NO_LOSS)
            .mean(axis=0)
            .tolist(),
        }
    study.write_summary(found, level=config.level)
    draw_means(
        study,
        {
            name: (each > _NO_LOSS).astype(float)
            for name, each in losses_of(rows, config).items()
        },
        ylabel="binary policy loss: share of the trials with any",
    )
    return lines


def _first_below(losses: np.ndarray, level: float) -> np.ndarray:
    """Return demonstrations at the first loss below a level, the first one included."""
    is_there = losses < level
    num_queries = np.where(
        is_there.any(axis=1), is_there.argmax(axis=1), losses.shape[1]
    )
    return np.asarray(num_queries + 1.0)
