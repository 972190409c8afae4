"""Whether everything that the commands need is there and works."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tablesetting.planner.pick_place import Plan, plan
from tablesetting.results import package_versions
from tablesetting.scene.scene import Scene

_KNOWN_GOOD = {
    "mujoco": "3.17",
    "dm-control": "1.0.50",
    "mink": "1.3",
    "rerun-sdk": "0.41",
}
"""The releases that are tested together."""

_REACH_TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)
_GL_BACKENDS = ("egl", "osmesa")
_GL_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco/>")
renderer = mujoco.Renderer(model, 16, 16)
renderer.update_scene(mujoco.MjData(model))
renderer.render()
renderer.close()
"""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        subject: What.
        detail: How it is.
        is_well: Whether the commands work with it.
        remedy: What would mend or better it; None if nothing needs to be.
    """

    subject: str
    detail: str
    is_well: bool = True
    remedy: str | None = None


def diagnose(out: Path) -> Iterator[Finding]:
    """Look at everything, one finding at a time.

    Args:
        out: Folder that results go to.

    Yields:
        The findings; the slow one, the reach of the arm, last.
    """
    yield _python()
    for name, found in package_versions().items():
        yield _package(name, found)
    yield _rendering()
    yield _write_access(out)
    yield _reach()


def _python() -> Finding:
    found = ".".join(map(str, sys.version_info[:3]))
    if (3, 11) <= sys.version_info[:2] < (3, 13):
        return Finding("python", found)
    remedy = "make the virtual environment with Python 3.11 or 3.12"
    return Finding("python", f"{found}, needs 3.11 or 3.12", False, remedy)


def _package(name: str, found: str) -> Finding:
    good = _KNOWN_GOOD.get(name)
    if good is None or found == good or found.startswith(f"{good}."):
        return Finding(name, found)
    remedy = f"pip install '{name}=={good}{'' if good.count('.') > 1 else '.*'}'"
    return Finding(name, f"{found}, known to work is {good}", False, remedy)


def _rendering() -> Finding:
    """Try the backends that need no display, each in a process of its own."""
    for backend in _GL_BACKENDS:
        # A backend without its library makes `import mujoco` itself fail.
        probe = subprocess.run(
            [sys.executable, "-c", _GL_PROBE],
            env=os.environ | {"MUJOCO_GL": backend},
            capture_output=True,
            check=False,
        )
        if probe.returncode == 0:
            return Finding("MuJoCo rendering", f"MUJOCO_GL={backend}")
    return Finding(
        "MuJoCo rendering",
        "no headless backend; no command needs one",
        remedy="apt-get install --no-install-recommends libegl1 libgl1",
    )


def _write_access(out: Path) -> Finding:
    existing = next(path for path in (out, *out.absolute().parents) if path.exists())
    try:
        with tempfile.TemporaryFile(dir=existing):
            return Finding("write access", str(out))
    except OSError as error:
        detail = f"'{existing}': {error.strerror}"
        return Finding("write access", detail, False, "pass another folder to --out")


def _reach() -> Finding:
    """Plan a placement of the vase at points all over an empty table."""
    scene = Scene((), "vase")
    scene.reset(np.empty((0, 2)))
    points = np.array([(x, y) for y in _REACH_TICKS for x in _REACH_TICKS])
    plans = [plan(scene, target) for target in scene.frame.to_world(points)]
    num_reached = sum(isinstance(found, Plan) for found in plans)
    detail = f"{num_reached} of {len(points)} points of the square"
    if num_reached == len(points):
        return Finding("reach of the arm", detail)
    remedy = "install the releases of constraints.txt"
    return Finding("reach of the arm", detail, False, remedy)
