import numpy as np
import pytest

from tablesetting.errors import TableSettingError
from tablesetting.planner.pick_place import HOLDING, plan
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import SPOON, VASE
from tablesetting.scene import load
from tablesetting.scene.environment import TIME_LIMIT
from tablesetting.scene.jaw import MAX_OPENING
from tablesetting.scene.robot import HOME
from tablesetting.scene.scene import STAGING

STAY = np.array([*HOME, MAX_OPENING / 2])


@pytest.fixture(scope="module")
def compiled_environment():
    return load("vase", seed=0)


@pytest.fixture
def environment(compiled_environment):
    """The vase's, about to begin the first episode of seed 4."""
    compiled_environment.random_state.seed(4)
    return compiled_environment


def layout_of(moment, scene):
    return scene.frame.from_world(moment.observation["object_positions"][:, :2])


def put(environment, name, position, quaternion=(1.0, 0.0, 0.0, 0.0)):
    joint = environment.physics.model.ptr.body(f"{name}/").jntadr[0]
    start = environment.physics.model.ptr.jnt_qposadr[joint]
    environment.physics.data.qpos[start : start + 7] = [*position, *quaternion]


def carry_out(environment, found):
    """Step through a plan; return the moments of each phase."""
    return {
        step.phase: [
            environment.step(np.array([*position, step.opening]))
            for position in step.positions[4::5]
        ]
        for step in found.steps
    }


def test_an_unknown_task_is_refused_by_the_names_of_the_known():
    with pytest.raises(TableSettingError, match="'tea'; choose one of vase, spoon"):
        load("tea")


def test_an_episode_begins_with_a_valid_layout_and_the_arm_at_home(environment):
    observed = environment.reset().observation
    LayoutSpace.of_task(VASE, are_points=False).check(
        observed["object_positions"][:, :2] / 0.5 + 0.5
    )
    np.testing.assert_allclose(observed["arm_position"], HOME)
    np.testing.assert_array_equal(observed["arm_velocity"], np.zeros(6))
    np.testing.assert_allclose(observed["jaw_opening"], [MAX_OPENING / 2])
    np.testing.assert_allclose(observed["item_position"], [*STAGING, 0.0])
    np.testing.assert_array_equal(observed["item_quaternion"], [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(environment.physics.data.ctrl, STAY)


def test_an_action_is_six_joints_and_the_jaw(environment):
    names = environment.action_spec().name.split("\t")
    assert names == [
        *(f"jaco/joint_{k}" for k in range(1, 7)),
        "jaco/jaw/opening",
    ]
    environment.reset()
    target = STAY + [0.1, 0.1, -0.1, 0.2, -0.2, 0.3, 0.01]
    for _ in range(50):
        moment = environment.step(target)
    np.testing.assert_allclose(
        moment.observation["arm_position"], target[:6], atol=0.003
    )
    np.testing.assert_allclose(moment.observation["jaw_opening"], target[6:], atol=5e-4)


def test_the_same_seed_gives_the_same_episodes(environment):
    def play():
        environment.random_state.seed(7)
        rng = np.random.default_rng(0)
        for _ in range(2):
            yield environment.reset()
            for _ in range(10):
                yield environment.step(STAY + 0.02 * rng.normal(size=7))

    first, second = list(play()), list(play())
    for one, other in zip(first, second, strict=True):
        assert (one.step_type, one.reward) == (other.step_type, other.reward)
        for name, value in one.observation.items():
            np.testing.assert_array_equal(value, other.observation[name])
    layouts = [first[k].observation["object_positions"] for k in (0, 11)]
    assert not np.array_equal(*layouts)


def test_only_an_item_put_down_earns_what_its_place_is_worth(environment, vase_scene):
    layout = layout_of(environment.reset(), vase_scene)
    vase_scene.reset(layout)
    found = plan(vase_scene, (-0.06, -0.08))
    phases = carry_out(environment, found)
    held = [moment.reward for phase in HOLDING for moment in phases[phase]]
    assert held == [0.0] * len(held)
    assert phases["transfer"][-1].observation["item_position"][2] > 0.1
    last = phases["settle"][-1]
    place = vase_scene.frame.from_world(last.observation["item_position"][:2])
    np.testing.assert_allclose(place, [0.38, 0.34], atol=0.002)
    to_objects = np.linalg.norm(place - layout_of(last, vase_scene), axis=1)
    to_middle = np.linalg.norm(place - 0.5)
    expected = 0.6 * np.exp(-(to_middle**2) / 0.3)
    expected -= 0.1 * np.exp(-(to_objects**2) / 0.3).sum()
    assert last.reward == pytest.approx(expected, abs=1e-9)
    assert last.reward > 0.2


def test_a_spoon_in_the_bowl_earns_all(spoon_scene):
    environment = load("spoon", seed=4)
    layout = layout_of(environment.reset(), spoon_scene)
    spoon_scene.reset(layout)
    bowl = spoon_scene.frame.to_world(layout[SPOON.objects.index("bowl")])
    phases = carry_out(environment, plan(spoon_scene, bowl))
    assert phases["lower"][-1].reward == 0.0
    assert phases["settle"][-1].reward == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("position", "quaternion"),
    [
        ((0.3, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.033), (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)),
        ((0.0, 0.0, 0.3), (1.0, 0.0, 0.0, 0.0)),
    ],
    ids=["off the square", "fallen over", "in the air"],
)
def test_an_item_that_does_not_stand_on_the_square_earns_nothing(
    environment, position, quaternion
):
    environment.reset()
    for name in VASE.objects:
        put(environment, name, (-0.2, -0.2, -9.0))
    put(environment, "vase", (0.0, 0.0, 0.0))
    assert environment.step(STAY).reward != 0.0
    put(environment, "vase", position, quaternion)
    assert environment.step(STAY).reward == 0.0


def test_an_episode_ends_at_the_time_limit(environment):
    moment, num_steps = environment.reset(), 0
    while not moment.last():
        moment, num_steps = environment.step(STAY), num_steps + 1
    assert num_steps == round(TIME_LIMIT / 0.04)
    assert moment.discount == 1.0


def test_a_simulation_that_diverges_ends_its_episode(environment):
    environment.reset()
    moment = environment.step(np.full(7, np.nan))
    assert moment.last()
    assert (moment.reward, moment.discount) == (0.0, 0.0)
    assert environment.step(STAY).first()
