"""Draw the phases of two placements, close up: `python docs/draw_arm.py docs/arm.png`."""

import os
import sys

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from matplotlib.figure import Figure

from tablesetting.planner.place import place
from tablesetting.reward.tasks import SPOON, VASE, PlacementTask
from tablesetting.scene.robot import BASE_POSITION
from tablesetting.scene.scene import Scene

_PHASES = ("close", "transfer", "lower", "settle")
_LAYOUTS = {
    VASE: [[0.2, 0.3], [0.8, 0.75], [0.25, 0.75], [0.75, 0.3]],
    SPOON: [[0.3, 0.6], [0.8, 0.75], [0.75, 0.15], [0.9, 0.4], [0.05, 0.5], [0.6, 0.5]],
}
_PIXELS = (480, 480)


def main(path: str) -> None:
    """Draw a row for each task, with the frames of the tool, and save it."""
    figure = Figure(figsize=(12.8, 6.9), layout="constrained")
    panels = figure.subplots(len(_LAYOUTS), len(_PHASES))
    for task, row in zip(_LAYOUTS, panels, strict=True):
        for axes, (phase, pixels) in zip(row, _phases(task).items(), strict=True):
            axes.imshow(pixels)
            axes.set_title(f"{task.name}: {phase}", fontsize=11)
            axes.set_axis_off()
    figure.savefig(path, dpi=100)


def _phases(task: PlacementTask) -> dict[str, np.ndarray]:
    """Return the last picture of every phase that is drawn."""
    scene = Scene(task.objects, task.item)
    scene.reset(np.array(_LAYOUTS[task]))
    target = scene.position("bowl")[:2] if task is SPOON else np.array([0.0, 0.0])
    states = {}
    for snapshot in place(scene, target, frame_rate=125.0):
        states[snapshot.phase] = scene.data.qpos.copy()
    option = mujoco.MjvOption()
    option.frame = mujoco.mjtFrame.mjFRAME_SITE
    scale = scene.model.vis.scale
    scale.framelength, scale.framewidth = 0.7, 0.04
    pictures, data = {}, mujoco.MjData(scene.model)
    with mujoco.Renderer(scene.model, *_PIXELS) as renderer:
        for phase in _PHASES:
            data.qpos[:] = states[phase]
            mujoco.mj_forward(scene.model, data)
            renderer.update_scene(data, _camera(scene, data), option)
            pictures[phase] = renderer.render()
    return pictures


def _camera(scene: Scene, data: mujoco.MjData) -> mujoco.MjvCamera:
    """Look at the item from beyond it, towards the foot of the arm."""
    camera = mujoco.MjvCamera()
    camera.lookat[:] = data.xpos[scene.body_ids[scene.item]] + [0.0, 0.0, 0.08]
    away = data.xpos[scene.body_ids[scene.item]] - BASE_POSITION
    camera.azimuth = np.degrees(np.arctan2(away[1], away[0])) + 140.0
    camera.distance, camera.elevation = 0.65, -24.0
    return camera


if __name__ == "__main__":
    main(sys.argv[1])
