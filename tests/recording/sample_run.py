"""A small model and a run on it, to be recorded."""

import math
from collections.abc import Generator

import mujoco
import numpy as np

from tablesetting.recording import ExecutionView, RoundView, RunCard
from tablesetting.scene.scene import Snapshot

# One geom of every type, a body that never moves, an arm of two links and a free body;
# the link has a collision shape besides its looks, the free body nothing but one.
XML = """
<mujoco>
  <asset>
    <material name="blue" rgba="0 0 1 1"/>
    <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/>
  </asset>
  <worldbody>
    <geom name="top" type="plane" size=".6 .4 .1"/>
    <body name="stand/" pos=".1 .2 .3" euler="0 0 30">
      <geom name="stand/foot" type="cylinder" size=".05 .1" rgba="1 0 0 1"/>
      <body name="stand/link" pos="0 0 .2">
        <joint name="hinge" axis="0 1 0"/>
        <geom name="bone" type="capsule" fromto="0 0 0 .2 0 .1" size=".02"/>
        <geom name="hull" type="box" size=".2 .2 .2" group="3"/>
        <body name="tip" pos=".2 0 .1">
          <joint name="wrist" axis="1 0 0"/>
          <geom name="ball" type="sphere" size=".03" pos=".01 .02 .03"/>
          <geom name="egg" type="ellipsoid" size=".01 .02 .03" euler="10 20 30"/>
          <geom name="wedge" type="mesh" mesh="wedge" material="blue"/>
        </body>
      </body>
    </body>
    <body name="cup" pos="0 0 .5">
      <freejoint/>
      <geom name="cup_hull" type="box" size=".03 .02 .01" group="3"/>
    </body>
  </worldbody>
</mujoco>
"""

CARD = RunCard(
    task="vase",
    strategy="active-var",
    seed=7,
    objects=("plate", "bowl"),
    item="vase",
    versions={"mujoco": "3.17.0"},
)


def episode(
    model: mujoco.MjModel, num_frames: int = 10
) -> Generator[Snapshot, None, str]:
    """Half of the frames reach, the other half lift."""
    data = mujoco.MjData(model)
    data.qvel[:] = np.linspace(-1.0, 1.0, model.nv)
    for k in range(num_frames):
        mujoco.mj_step(model, data, 10)
        mujoco.mj_kinematics(model, data)
        phase = "reach" if k < num_frames // 2 else "lift"
        yield Snapshot(data.time, data.xpos.copy(), data.xquat.copy(), phase)
    return "done"


def round_view(num_demos: int = 1) -> RoundView:
    return RoundView(
        num_demos=num_demos,
        centers=np.array([[0.2, 0.3], [0.7, 0.6]]),
        reward_map=np.add.outer(np.arange(5.0), 10.0 * np.arange(5.0)),
        candidate_var=np.array([0.1, 0.4, 0.2]),
        asked=1,
        robot_placement=np.array([0.5, 0.5]),
        rival_map=np.add.outer(10.0 * np.arange(5.0), np.arange(5.0)),
        rival_placement=np.array([0.8, 0.5]),
        sampled_placements=np.array([[0.5, 0.5], [0.8, 0.5], [0.4, 0.45]]),
        wish=np.array([0.5, 0.6]),
        var_bound=0.2 / num_demos,
        deployment_bound=0.25 if num_demos > 1 else math.inf,
        placement_errors=np.array([0.0, 0.0, 0.1, 0.3]),
        reason="Asked here because candidate 1 is the worst.",
    )


EXECUTION = ExecutionView(np.array([0.5, 0.5]), np.array([0.5, 0.502]), None)
