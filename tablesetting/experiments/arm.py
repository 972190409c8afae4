"""The arm at work: from a layout and a placement on the table to how it went."""

from dataclasses import dataclass
from time import perf_counter

from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import execute, run_to_end
from tablesetting.planner.pick_place import Refusal, plan
from tablesetting.recording import RunRecorder
from tablesetting.scene.scene import Scene


@dataclass(frozen=True)
class Attempt:
    """One placement that the arm was told to make.

    Attributes:
        commanded: Where the item was to be put, shape (2,), in table units.
        settled: Where it came to rest, shape (2,), in table units; None if the
            placement was refused before any motion, as are the next three.
        error_mm: Distance of the two.
        tilt_deg: Tilt of the item at rest.
        max_bystander_shift_mm: Furthest that any object was moved.
        failure: Why it was refused or is no success; None for a success.
        seconds: Time that planning and simulation took.
    """

    commanded: Array
    settled: Array | None
    error_mm: float | None
    tilt_deg: float | None
    max_bystander_shift_mm: float | None
    failure: str | None
    seconds: float

    @property
    def is_refused(self) -> bool:
        """Whether nothing was moved."""
        return self.settled is None


def place(
    scene: Scene, recorder: RunRecorder, layout: Array, placement: Array
) -> Attempt:
    """Set a layout up and let the arm put the item at a placement.

    Args:
        scene: The table; it is laid anew.
        recorder: Sees every motion.
        layout: Object centers, shape (K, 2), in table units.
        placement: Where to put the item, shape (2,), in table units.

    Returns:
        How it went; a placement that cannot be carried out is refused, not raised.
    """
    started = perf_counter()
    scene.reset(layout)
    found = plan(scene, scene.frame.to_world(placement))
    if isinstance(found, Refusal):
        recorder.show(scene.snapshot())
        reason = f"refused, {found.reason}: {found.detail}"
        seconds = perf_counter() - started
        return Attempt(placement, None, None, None, None, reason, seconds)
    execution = run_to_end(recorder.record(execute(scene, found)))
    return Attempt(
        commanded=placement,
        settled=scene.frame.from_world(execution.settled),
        error_mm=execution.error_mm,
        tilt_deg=execution.tilt_deg,
        max_bystander_shift_mm=execution.max_bystander_shift_mm,
        failure=execution.failure,
        seconds=perf_counter() - started,
    )
