"""What is said of a round, in Markdown."""

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.recording.views import ExecutionView, RoundView
from tablesetting.scene.table import TableFrame

_NEGLIGIBLE_MM = 0.5


def round_markdown(
    view: RoundView, frame: TableFrame, execution: ExecutionView | None = None
) -> str:
    """Write what is known in a round, and how the arm fared once it has acted."""
    errors = view.placement_errors
    lines = [
        f"- Bound over the deployment {view.deployment_bound:.3f}, value at risk in the "
        f"worst candidate {view.var_bound:.3f}"
        + (
            f", placement error on test layouts: mean {errors.mean():.3f}, "
            f"max {errors.max():.3f}"
            if errors is not None
            else ""
        )
        + " (table units)",
        f"- Best guess {_point(view.robot_placement)}, rival "
        f"{_point(view.rival_placement)}",
    ]
    if view.wish is not None:
        error = distance_mm(frame, view.robot_placement, view.wish)
        lines.append(
            f"- Person's wish {_point(view.wish)}: learning error {error:.1f} mm"
        )
    if execution is not None:
        lines.append(f"- {_execution_sentence(execution, frame)}")
        detour = distance_mm(frame, view.robot_placement, execution.commanded)
        if detour >= _NEGLIGIBLE_MM:
            lines.append(
                f"- The item does not fit at the best guess: commanded {detour:.0f} mm "
                "beside it"
            )
    title = f"# After {view.num_demos} demonstration{'s'[: view.num_demos != 1]}"
    return "\n\n".join([title, view.reason, "\n".join(lines)])


def _execution_sentence(execution: ExecutionView, frame: TableFrame) -> str:
    """Say in one line where the item was to go and where it went."""
    start = f"Commanded {_point(execution.commanded)}"
    if execution.settled is not None:
        error = distance_mm(frame, execution.commanded, execution.settled)
        start += (
            f", settled {_point(execution.settled)}: execution error {error:.2f} mm"
        )
    if execution.failure is not None:
        return f"{start}, failed: {execution.failure}"
    return f"{start}, success"


def distance_mm(frame: TableFrame, a: Array, b: Array) -> float:
    """Measure how far apart two placements lie on the table, in [mm]."""
    return float(1e3 * np.linalg.norm(frame.to_world(a) - frame.to_world(b)))


def _point(placement: Array) -> str:
    return f"({placement[0]:.3f}, {placement[1]:.3f})"
