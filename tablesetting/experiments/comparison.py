"""The curves of a study as tables, the published points beside ours."""

from collections.abc import Iterable, Mapping, Sequence

from tablesetting.curves import Curve, CurveKey, Curves, Reach
from tablesetting.experiments.published import Difference

_WORDS = {
    "mean_placement_error": "mean error",
    "max_placement_error": "largest error",
    "var_bound": "bound",
    "bound_held": "trials in which the bound held [%]",
    "test_var_bound": "bound over the test layouts",
    "test_bound_held": "trials in which that bound held [%]",
}


def compare(
    title: str,
    curves: Curves,
    found: Sequence[Difference],
    gains: Mapping[str, Mapping[str, Curve]],
    reached: Mapping[str, Sequence[Reach]],
) -> str:
    """Write one table for each task, in Markdown.

    Args:
        title: The settings of the study.
        curves: Means over the trials.
        found: Differences from the paper; none where the settings are not the paper's.
        gains: By task and strategy, how much larger its mean error is than that of the
            study's first strategy, trial by trial.
        reached: By task, how many demonstrations each strategy takes to small errors.
    """
    lines = [
        f"Placement study: {title}. Errors and bounds are in table units, means over "
        "the trials."
    ]
    if found:
        within = sum(difference.is_within_bar for difference in found)
        lines[0] += (
            " The distance from ours to the paper's mean is in the paper's error bars, "
            f"half a standard deviation long: {within} of {len(found)} points are within "
            "theirs."
        )
    for task in dict.fromkeys(key.task for key in curves):
        own = {key: curve for key, curve in curves.items() if key.task == task}
        lines += ["", f"## {task}", "", *_head(own)]
        for key, curve in own.items():
            lines += _curve_rows(
                key, curve, [each for each in found if each.key == key]
            )
        first = next(iter(own)).strategy
        lines += [
            _gain_row(strategy, first, gain)
            for strategy, gain in gains.get(task, {}).items()
        ]
        lines += _reach_table(reached.get(task, ()))
    return "\n".join(lines) + "\n"


def _head(curves: Curves) -> list[str]:
    num_demos = next(iter(curves.values())).num_demos
    names = _row("after demonstrations", (f"{count:.0f}" for count in num_demos))
    return [names, "|---" * (len(num_demos) + 1) + "|"]


def _curve_rows(key: CurveKey, curve: Curve, found: Sequence[Difference]) -> list[str]:
    """Write a curve, and below it the published one and how far that is."""
    label = f"{key.strategy}, {_WORDS[key.quantity]}"
    if key.quantity.endswith("_held"):
        return [_row(label, (f"{100.0 * mean:.0f}" for mean in curve.means))]
    rows = [_row(label, (f"{mean:.3f}" for mean in curve.means))]
    if found:
        points = {difference.num_demos: difference for difference in found}
        beside = [points.get(int(num_demos)) for num_demos in curve.num_demos]
        rows += [
            _row("paper", (f"{each.published:.3f}" if each else "" for each in beside)),
            _row("distance", (f"{each.bars:.2f}" if each else "" for each in beside)),
        ]
    return rows


def _reach_table(reached: Sequence[Reach]) -> list[str]:
    """Write how many demonstrations each strategy takes, and as a share of Random's."""
    levels = list(dict.fromkeys(each.level for each in reached))
    if not levels:
        return []
    lines = [
        "",
        "Means ± their standard error. Trials that never got there count one "
        "demonstration more than they had, so that ≥ and ≤ mark what is a bound.",
        "",
        _row(
            "demonstrations to a mean error of",
            (f"{level:g} | of random's" for level in levels),
        ),
        "|---" * (2 * len(levels) + 1) + "|",
    ]
    missed = {e.level: e.num_missed for e in reached if e.strategy == "random"}
    for strategy in dict.fromkeys(each.strategy for each in reached):
        cells = []
        for each in (each for each in reached if each.strategy == strategy):
            cells += [_count_cell(each), _ratio_cell(each, missed.get(each.level, 0))]
        lines.append(_row(strategy, cells))
    return lines


def _count_cell(each: Reach) -> str:
    count = f"{each.mean:.2f} ± {each.standard_error:.2f}"
    if not each.num_missed:
        return count
    return f"≥ {count} ({each.num_missed} of {each.num_trials} never)"


def _ratio_cell(each: Reach, num_missed_at_random: int) -> str:
    """Write a ratio, which says nothing where both sides are bounds."""
    is_bound = bool(each.num_missed), bool(num_missed_at_random)
    if each.ratio is None or each.strategy == "random" or all(is_bound):
        return ""
    sign = "≥ " if is_bound[0] else "≤ " if is_bound[1] else ""
    return f"{sign}{each.ratio:.0%} ± {each.ratio_error:.0%}"


def _gain_row(strategy: str, first: str, gain: Curve) -> str:
    cells = (
        f"{mean:z.3f} ± {error:.3f}"
        for mean, error in zip(gain.means, gain.standard_errors, strict=True)
    )
    return _row(f"mean error of {strategy} less that of {first}, paired", cells)


def _row(label: str, cells: Iterable[str]) -> str:
    return f"| {label} | {' | '.join(cells)} |"
