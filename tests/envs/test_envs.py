import importlib
import re
import subprocess
import sys

import numpy as np
import pytest

from tablesetting.errors import InvalidLayout, TableSettingError
from tablesetting.reward.rbf import TABLE_CENTERS
from tablesetting.scene.robot import HOME

gymnasium = pytest.importorskip("gymnasium")
check_env = importlib.import_module("gymnasium.utils.env_checker").check_env
envs = importlib.import_module("tablesetting.envs")

IDS = tuple(
    f"tablesetting/{name}-v0"
    for name in ("PlaceVase", "PlaceSpoon", "VaseJoints", "SpoonJoints")
)
LAYOUT = np.array([[0.2, 0.3], [0.7, 0.7], [0.2, 0.75], [0.75, 0.25]])
TICKS = np.linspace(0.0, 1.0, 101)
SQUARE = np.stack(np.meshgrid(TICKS, TICKS), axis=-1).reshape(-1, 2)


@pytest.fixture(scope="module")
def vase_env():
    return gymnasium.make("tablesetting/PlaceVase-v0")


def vase_rewards(points, layout):
    """The preference for the vase, by hand, at points (G, 2)."""

    def bumps(centers):
        squared = ((points[:, None] - centers) ** 2).sum(axis=-1)
        return np.exp(-squared / 0.3)

    return 0.6 * bumps(TABLE_CENTERS[4:5])[:, 0] - 0.1 * bumps(layout).sum(axis=1)


@pytest.mark.parametrize("env_id", IDS)
def test_an_environment_is_as_gymnasium_wants_it(env_id):
    check_env(gymnasium.make(env_id).unwrapped, skip_render_check=True)


def test_importing_the_package_registers_and_loads_no_simulator():
    code = (
        "import sys, gymnasium, tablesetting.envs\n"
        "print(*(id for id in gymnasium.registry if id.startswith('tablesetting/')))\n"
        "print('mujoco' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    *registered, has_loaded = done.stdout.split()
    assert sorted(registered) == sorted(IDS)
    assert has_loaded == "False"


def test_gymnasium_imports_the_package_named_before_the_id():
    env = gymnasium.make("tablesetting.envs:tablesetting/PlaceSpoon-v0", fast=True)
    assert env.observation_space.shape == (6, 2)
    assert env.unwrapped._scene.model.opt.timestep == 0.004


def test_to_register_once_more_overrides_nothing():
    before = [gymnasium.spec(env_id) for env_id in IDS]
    envs.register()
    after = [gymnasium.spec(env_id) for env_id in IDS]
    assert all(one is other for one, other in zip(before, after, strict=True))


def test_the_package_itself_does_not_need_gymnasium():
    code = (
        "import sys\nsys.modules['gymnasium'] = None\nimport tablesetting\n"
        "try:\n    import tablesetting.envs\n"
        "except ModuleNotFoundError as error:\n    print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert "pip install 'tablesetting[gym]'" in done.stdout


def test_the_best_placement_earns_nearly_the_best_reward(vase_env):
    observed, _ = vase_env.reset(seed=0, options={"layout": LAYOUT})
    np.testing.assert_allclose(observed, LAYOUT, atol=1e-5)
    _, reward, *_, info = vase_env.step(np.array([0.45, 0.5]))
    assert info["success"]
    assert reward == pytest.approx(
        vase_rewards(info["settled"][None], LAYOUT)[0], abs=1e-5
    )
    best = vase_rewards(info["best_placement"][None], LAYOUT)[0]
    assert info["best_reward"] == pytest.approx(best)
    assert info["regret"] == best - reward > 1e-3

    vase_env.reset(options={"layout": LAYOUT})
    *_, terminated, truncated, info = vase_env.step(info["best_placement"])
    assert (terminated, truncated) == (True, False)
    assert info["error_mm"] < 0.6
    assert abs(info["regret"]) < 1e-5


@pytest.mark.parametrize(
    ("placement", "why"),
    [((0.72, 0.7), "occupied: the vase would"), ((0.5, 1.1), "outside: .* is off")],
)
def test_a_refused_placement_earns_the_least(vase_env, placement, why):
    vase_env.reset(options={"layout": LAYOUT})
    _, reward, terminated, _, info = vase_env.step(np.array(placement))
    assert terminated
    assert info["is_refused"]
    assert not info["success"]
    assert re.match(f"refused, {why}", info["failure"])
    least = vase_rewards(SQUARE, LAYOUT).min()
    assert least - 1e-3 < reward <= least


def test_an_episode_is_one_placement_long(vase_env):
    vase_env.reset(seed=0)
    with pytest.raises(ValueError, match="two finite numbers; got"):
        vase_env.step(np.array([0.5, np.nan]))
    vase_env.step(np.array([1.0, 1.1]))
    with pytest.raises(gymnasium.error.ResetNeeded, match="call `reset`"):
        vase_env.step(np.array([0.5, 0.5]))


def test_joints_stop_at_the_end_of_the_episode_until_reset():
    env = gymnasium.make("tablesetting/VaseJoints-v0").unwrapped
    home = env.action_for(HOME, 0.02)
    assert env.action_space.contains(home)
    assert env.action_space.contains(env.action_for(np.full(6, 1e3), 0.02))
    with pytest.raises(gymnasium.error.ResetNeeded, match="call `reset`"):
        env.step(home)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(7,\); got \(3,\)"):
        env.step(np.zeros(3))
    *_, terminated, _, _ = env.step(np.full(7, np.nan))
    assert terminated
    with pytest.raises(gymnasium.error.ResetNeeded, match="call `reset`"):
        env.step(home)


def test_a_bad_layout_or_task_or_mode_is_refused(vase_env):
    with pytest.raises(InvalidLayout, match="too close"):
        vase_env.reset(options={"layout": np.full((4, 2), 0.5)})
    for env_id in IDS[::2]:
        with pytest.raises(TableSettingError, match="'tea'; choose one of vase"):
            gymnasium.make(env_id, task="tea")
    with pytest.raises(TableSettingError, match="MUJOCO_GL=egl before Python starts"):
        gymnasium.make(IDS[0], render_mode="rgb_array")  # The tests have no backend.


def test_the_same_seed_gives_the_same_reward_to_the_bit(vase_env):
    other = gymnasium.make("tablesetting/PlaceVase-v0")
    other.reset(seed=1)
    other.step(np.array([0.3, 0.6]))
    first, _ = vase_env.reset(seed=3)
    second, _ = other.reset(seed=3)
    np.testing.assert_array_equal(first, second)
    placement = np.array([0.5, 0.02])
    outcomes = [env.step(placement) for env in (vase_env, other)]
    assert outcomes[0][1] == outcomes[1][1]
    assert outcomes[0][4]["settled"].tolist() == outcomes[1][4]["settled"].tolist()


def test_environments_share_no_state(vase_env):
    other = gymnasium.make("tablesetting/PlaceVase-v0")
    vase_env.reset(options={"layout": LAYOUT})
    other.reset(options={"layout": LAYOUT[[0, 1, 3, 2]]})
    _, _, _, _, info = other.step(np.array([0.5, 0.5]))
    observed, *_, own_info = vase_env.step(np.array([0.72, 0.7]))
    np.testing.assert_allclose(observed, LAYOUT, atol=1e-5)
    assert info["success"]
    assert own_info["settled"][0] > 1.0  # Still beside the square.


def test_joints_go_where_they_are_told():
    env = gymnasium.make("tablesetting/VaseJoints-v0")
    first, _ = env.reset(seed=5)
    again, _ = env.reset(seed=5)
    for name, value in first.items():
        np.testing.assert_array_equal(value, again[name])
    targets = np.array(HOME) + 0.1
    action = env.unwrapped.action_for(targets, 0.01)
    num_steps, is_over = 0, False
    while not is_over:
        observed, reward, terminated, is_over, _ = env.step(action)
        num_steps += 1
        assert (reward, terminated) == (0.0, False)
    assert num_steps == 500
    np.testing.assert_allclose(observed["arm_position"], targets, atol=0.003)
    np.testing.assert_allclose(observed["jaw_opening"], [0.01], atol=5e-4)


@pytest.mark.parametrize(
    ("mode", "vector_kwargs"),
    [("sync", {}), ("async", {"context": "spawn"})],  # Python 3.12 warns of forks.
)
def test_environments_run_side_by_side(vase_env, mode, vector_kwargs):
    vectorised = gymnasium.make_vec(
        "tablesetting/PlaceVase-v0",
        num_envs=2,
        vectorization_mode=mode,
        vector_kwargs=vector_kwargs,
    )
    observed, _ = vectorised.reset(seed=[3, 8])
    placements = np.array([[0.5, 0.02], [0.72, 0.7]])
    _, rewards, terminated, _, infos = vectorised.step(placements)
    vectorised.close()
    assert terminated.all()
    for k, seed in enumerate((3, 8)):
        single, _ = vase_env.reset(seed=seed)
        np.testing.assert_array_equal(observed[k], single)
        _, reward, _, _, info = vase_env.step(placements[k])
        assert rewards[k] == reward
        assert infos["failure"][k] == info["failure"]
