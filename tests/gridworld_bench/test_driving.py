import json
import time
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from refusals import refusal

from gridworld_bench import cli, window
from gridworld_bench.drives import LONGEST, read_drive, save_drive, shipped_drive
from gridworld_bench.driving import DrivingProblem, Record, Riskiest, drive
from gridworld_bench.experiments import driving, trials
from gridworld_bench.experiments.config import MOST, DrivingStudyConfig
from gridworld_bench.experiments.trials import Trial
from gridworld_bench.highway import (
    ACTIONS,
    DRIVERS,
    STAY,
    Highway,
    Situation,
    stationary_probabilities,
)
from gridworld_bench.likelihood import Evidence
from tablesetting.irl.active import run_active
from tablesetting.recording.reading import Recording
from tablesetting.results import RunFolder, read_rows

FEW = ("--num-samples", "60", "--num-sampled-states", "30")


@pytest.fixture
def keys(monkeypatch):
    """Press keys, one each time that the road is shown, through pygame's own queue."""
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pressed = []
    show = window.Window.show

    def show_and_press(self, *args, **options):
        show(self, *args, **options)
        key = pressed.pop(0)
        if key == "close":
            pygame.event.post(pygame.event.Event(pygame.QUIT))
        elif key is not None:
            code = getattr(pygame, f"K_{key}")
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=code))

    monkeypatch.setattr(window.Window, "show", show_and_press)
    return pressed


def run_drive(out, *options):
    return cli.main(["drive", "--length", "4", "--out", str(out), *map(str, options)])


def test_arrow_keys_drive_and_backspace_takes_a_step_back(keys, tmp_path, capsys):
    keys += ["LEFT", "UP", "BACKSPACE", "RIGHT", "p", "p", "s", "UP"]
    out = tmp_path / "new" / "demos.json"
    assert run_drive(out, "--steps", 3) == 0
    driven = read_drive(out)
    assert [ACTIONS[action] for action in driven.actions] == ["left", "right", "stay"]
    assert driven.driver == "person"
    for state, action, there in zip(
        driven.states, driven.actions, driven.states[1:], strict=False
    ):
        mdp = driven.highway.mdp
        chance = mdp.probabilities[state, action][
            mdp.successors[state, action] == there
        ]
        assert chance.sum() > 0.0
    assert "3 steps by person" in capsys.readouterr().out


def test_in_real_time_no_key_is_to_stay(keys, tmp_path):
    keys += [None, "LEFT", None]
    out = tmp_path / "demos.json"
    assert run_drive(out, "--steps", 3, "--period", 0.05) == 0
    assert read_drive(out).actions == (STAY, ACTIONS.index("left"), STAY)


@pytest.mark.parametrize("end", ["close", "q", "ESCAPE"])
def test_a_window_that_is_closed_keeps_what_was_driven(keys, tmp_path, capsys, end):
    keys += ["UP", "LEFT", end]
    out = tmp_path / "demos.json"
    assert run_drive(out, "--steps", 9) == 0
    assert len(read_drive(out).states) == 2
    assert "ended after 2 of 9 steps, which are saved" in capsys.readouterr().err


def test_in_real_time_the_last_of_two_keys_counts_and_a_command_comes_after(
    monkeypatch,
):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with window.open_window(3, (), remedy="do not") as opened:
        for key in (pygame.K_LEFT, pygame.K_RIGHT):
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        started = time.monotonic()
        assert opened.wait_for_key(0.1) == "right"
        assert time.monotonic() - started >= 0.09
        for key in (pygame.K_LEFT, pygame.K_s):
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        assert [opened.wait_for_key(0.1) for _ in range(2)] == ["left", "save"]


def test_a_pause_lasts_until_somebody_drives_on(monkeypatch, tmp_path):
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    commands = ["left", "pause", "save", "right"]
    waits, told = [], []
    show = window.Window.show

    def wait(self, seconds=None):
        waits.append(seconds)
        return commands.pop(0)

    def show_and_note(self, situation, num_steps, words=()):
        told.append("paused" in words[0])
        show(self, situation, num_steps, words)

    monkeypatch.setattr(window.Window, "wait_for_key", wait)
    monkeypatch.setattr(window.Window, "show", show_and_note)
    assert run_drive(tmp_path / "demos.json", "--steps", 2, "--period", 9) == 0
    assert waits == [9.0, 9.0, None, None]
    assert told == [False, False, True, True]


def test_what_is_all_undone_is_not_kept(keys, tmp_path, capsys):
    keys += ["LEFT", "BACKSPACE", "q"]
    out = tmp_path / "demos.json"
    assert run_drive(out) == 1
    assert "nothing is saved" in capsys.readouterr().err
    assert not out.exists()


def test_undo_before_the_first_step_leaves_an_earlier_drive(keys, tmp_path):
    out = tmp_path / "demos.json"
    assert run_drive(out, "--driver", "safe", "--steps", 2) == 0
    before = out.read_bytes()
    keys += ["BACKSPACE", "s", "q"]
    assert run_drive(out, "--overwrite") == 1
    assert out.read_bytes() == before


def test_keys_that_come_fast_are_all_obeyed(monkeypatch, tmp_path):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    show, pressed = window.Window.show, []

    def show_and_press_all(self, *args, **options):
        show(self, *args, **options)
        if not pressed:
            pressed.extend((pygame.K_LEFT, pygame.K_UP, pygame.K_RIGHT))
            for key in pressed:
                pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))

    monkeypatch.setattr(window.Window, "show", show_and_press_all)
    out = tmp_path / "demos.json"
    assert run_drive(out, "--steps", 3) == 0
    assert [ACTIONS[k] for k in read_drive(out).actions] == ["left", "stay", "right"]


@pytest.mark.parametrize("length", [2, 10, 60])
def test_a_window_fits_on_the_display(monkeypatch, length):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with window.open_window(length, ("a key",), remedy="do not") as opened:
        opened.show(Situation(2, ((2, 1),)), 0)
        screen = pygame.display.get_surface()
        assert screen.get_height() < pygame.display.get_desktop_sizes()[0][1]
        image = pygame.surfarray.array3d(screen)
        red = (image[..., 0] > 180) & (image[..., 1] < 100) & (image[..., 2] < 90)
        assert red.any()  # The driver's car.


def test_nothing_driven_is_nothing_saved(keys, tmp_path, capsys):
    keys += ["close"]
    out = tmp_path / "demos.json"
    assert run_drive(out) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("driver", ["none at all", "", None])
def test_without_a_display_one_line_says_so(monkeypatch, tmp_path, capsys, driver):
    pygame = pytest.importorskip("pygame")
    if driver is None:
        monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
        monkeypatch.setenv("DISPLAY", ":0")
        monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
        monkeypatch.setattr(pygame.display, "init", lambda: None)
    else:
        monkeypatch.setenv("SDL_VIDEODRIVER", driver)
    if driver == "":
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            monkeypatch.delenv(name, raising=False)
    assert run_drive(tmp_path / "demos.json") == 1
    error = capsys.readouterr().err
    assert error.startswith("error: no window can be opened")
    assert error.count("\n") == 1


def test_a_script_drives_and_an_earlier_drive_stays(tmp_path, capsys):
    out = tmp_path / "demos.json"
    assert run_drive(out, "--driver", "safe", "--steps", 7) == 0
    before = out.read_bytes()
    drive = read_drive(out)
    assert (len(drive.states), drive.driver) == (7, "safe")
    assert "overwrite" in refusal(
        capsys, cli.main, "drive", "--driver", "safe", "--out", out
    )
    other = tmp_path / "other.json"
    other.write_text("{}")
    assert "no drive" in refusal(
        capsys, cli.main, "drive", "--driver", "safe", "--overwrite", "--out", other
    )
    assert out.read_bytes() == before
    assert run_drive(out, "--driver", "safe", "--steps", 7, "--overwrite") == 0
    assert out.read_bytes() == before


@pytest.mark.parametrize("driver", DRIVERS)
def test_shipped_drives_are_what_the_drivers_do(driver):
    drive = shipped_drive(driver)
    policy = drive.highway.driver_policy(driver)
    assert drive.driver == driver
    assert len(drive.states) == 20
    np.testing.assert_array_equal(drive.actions, policy[list(drive.states)])


def test_a_drive_survives_the_disk(tmp_path):
    drive = shipped_drive("safe")
    save_drive(tmp_path / "drive.json", drive)
    found = read_drive(tmp_path / "drive.json")
    assert (found.states, found.actions) == (drive.states, drive.actions)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"length": 1}, "`length`"),
        ({"length": True}, "`length`"),
        ({"length": 61}, "`length`"),
        ({"steps": []}, "`steps`"),
        ({"steps": [{"position": 9, "cars": [], "action": "left"}]}, "step 0"),
        ({"steps": [{"position": 2, "cars": [[1, 10]], "action": "left"}]}, "step 0"),
        ({"steps": [{"position": True, "cars": [], "action": "left"}]}, "step 0"),
        ({"steps": [{"position": 2, "cars": [], "action": "up"}]}, "step 0"),
        ({"steps": [{"position": 2, "cars": None, "action": "left"}]}, "step 0"),
        (
            {"steps": [{"position": 2, "cars": [[1, 4]] * 2, "action": "left"}]},
            "different places",
        ),
        ({"steps": ["left"]}, "step 0"),
        ({"driver": ["safe"]}, "`driver`"),
        ({"driver": "\x1b[31m"}, "`driver`"),
        ({"format": "else/1"}, "else/1"),
    ],
)
def test_a_bad_drive_is_refused_in_one_line(tmp_path, capsys, change, words):
    path, out = tmp_path / "drive.json", tmp_path / "out"
    save_drive(path, shipped_drive("safe"))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    error = refusal(capsys, cli.main, "driving", "--demos", path, "--out", out)
    assert words in error
    assert not out.exists()


@pytest.mark.parametrize(
    "options",
    [
        ("--steps", "10", "5"),
        ("--steps", "0"),
        ("--steps", "21"),
        ("--epsilon", "0"),
        ("--answers", "person"),
        ("--num-samples", "1"),
        ("--driver", "blind"),
        ("--demos", "nowhere.json"),
    ],
)
def test_bad_options_are_refused_in_one_line(tmp_path, capsys, options):
    refusal(capsys, cli.main, "driving", *options, "--out", tmp_path / "out")


def test_options_and_files_have_the_same_longest_road():
    assert MOST["length"] == LONGEST


def run_driving(out, *options):
    return cli.main(["driving", *FEW, "--out", str(out), *map(str, options)])


def test_driving_writes_rows_pictures_and_a_recording(tmp_path, capsys):
    out = tmp_path / "out"
    assert run_driving(out, "--steps", "5", "8", "--num-queries", "2") == 0
    rows = read_rows(out / "rounds.csv")
    assert [(row["num_steps"], row["num_queries"]) for row in rows] == [
        ("5", "0"),
        ("8", "0"),
        ("8", "1"),
        ("8", "2"),
    ]
    assert [row["answer"] != "" for row in rows] == [False, True, True, False]
    assert (out / "figures" / "riskiest.png").stat().st_size > 10_000
    assert (out / "recording.rrd").stat().st_size > 10_000
    rounds = json.loads((out / "riskiest.json").read_text())["rounds"]
    for row, each in zip(rows, rounds, strict=True):
        values = [found["var"] for found in each["riskiest"]]
        assert values == sorted(values, reverse=True)
        assert len(values) == 10
        assert float(row["var"]) == pytest.approx(values[0])
    assert capsys.readouterr().out.count("| 8 |") == 3
    recording = Recording(out / "recording.rrd")
    told = recording.rows("/answer", "TextDocument:text")
    assert [row.value for row in told] == [row["answer"] for row in rows[1:3]]
    driven = recording.rows("/action", "TextDocument:text")
    expected = [f"safe: {ACTIONS[k]}" for k in shipped_drive("safe").actions[:8]]
    assert [row.value for row in driven] == expected
    again = tmp_path / "again"
    assert run_driving(again, "--steps", "5", "8", "--num-queries", "2") == 0
    assert (again / "rounds.csv").read_bytes() == (out / "rounds.csv").read_bytes()
    error = refusal(capsys, cli.main, "driving", *FEW, "--out", out)
    assert "--resume" not in error
    assert run_driving(out, "--steps", "5", "--overwrite") == 0
    assert (out / "rounds.csv").read_bytes() != (again / "rounds.csv").read_bytes()


def test_questions_end_once_nothing_is_risky(tmp_path, capsys):
    out = tmp_path / "out"
    options = ("--steps", "20", "--num-queries", "3", "--epsilon", "1000")
    assert run_driving(out, *options) == 0
    assert len(read_rows(out / "rounds.csv")) == 1
    assert "No more questions" in capsys.readouterr().out


def test_as_many_steps_are_learned_from_as_are_asked_for(monkeypatch, tmp_path):
    shown = []

    def spy(problem, first, *args, **options):
        shown.extend(first)
        return run_active(problem, first, *args, **options)

    monkeypatch.setattr(driving, "run_active", spy)
    assert run_driving(tmp_path / "out", "--steps", "5", "8") == 0
    states = list(shipped_drive("safe").states)
    assert [each.states.tolist() for each in shown] == [states[:5], states[:8]]


def test_steps_and_answers_are_a_drive_to_go_on_with(tmp_path, capsys):
    out, again = tmp_path / "out", tmp_path / "again"
    options = ("--driver", "right-lane", "--steps", "5")
    assert run_driving(out, *options, "--queries", "2") == 0
    rows = read_rows(out / "rounds.csv")
    known = read_drive(out / "demos.json")
    assert known.driver == "right-lane"
    assert known.states[:5] == shipped_drive("right-lane").states[:5]
    answers = [ACTIONS[action] for action in known.actions[5:]]
    assert answers == [row["answer"] for row in rows[:2]]
    policy = known.highway.driver_policy("right-lane")
    assert known.actions[5:] == tuple(policy[list(known.states[5:])])
    options = ("--demos", out / "demos.json", "--steps", "7", "--num-queries", "1")
    capsys.readouterr()
    assert run_driving(again, *options) == 0
    assert "answers by right-lane" in capsys.readouterr().out
    assert len(read_drive(again / "demos.json").states) == 8


def test_what_was_learned_stays_when_it_is_interrupted(monkeypatch, tmp_path, capsys):
    out, demonstrate = tmp_path / "out", DrivingProblem.demonstrate

    def interrupt(self, query, *, rng):
        demonstrate(self, query, rng=rng)
        raise KeyboardInterrupt

    monkeypatch.setattr(DrivingProblem, "demonstrate", interrupt)
    assert run_driving(out, "--steps", "5", "--num-queries", "4") == 130
    assert str(out) in capsys.readouterr().err
    assert len(read_drive(out / "demos.json").states) == 6
    for name in ("figures/riskiest.png", "recording.rrd", "summary.json"):
        assert (out / name).exists()


def test_a_key_that_is_pressed_too_early_answers_nothing(keys, monkeypatch, tmp_path):
    pygame = pytest.importorskip("pygame")
    say = window.Window.say

    def say_and_press(self, words):
        say(self, words)
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_RIGHT))

    monkeypatch.setattr(window.Window, "say", say_and_press)
    keys += ["LEFT", "UP"]
    out = tmp_path / "out"
    options = ("--steps", "5", "--num-queries", "2", "--answers", "person")
    assert run_driving(out, *options) == 0
    answered = read_drive(out / "demos.json").actions[5:]
    assert [ACTIONS[action] for action in answered] == ["left", "stay"]


@pytest.mark.parametrize(("steps", "is_early"), [(("5", "8"), True), (("5",), False)])
def test_a_window_closed_while_it_learns_ends_what_is_not_over(
    monkeypatch, tmp_path, capsys, steps, is_early
):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    say = window.Window.say

    def say_and_close(self, words):
        say(self, words)
        pygame.event.post(pygame.event.Event(pygame.QUIT))

    monkeypatch.setattr(window.Window, "say", say_and_close)
    out, options = tmp_path / "out", ("--num-queries", "2", "--answers", "person")
    assert run_driving(out, "--steps", *steps, *options, "--epsilon", "1000") == 0
    assert len(read_rows(out / "rounds.csv")) == 1
    assert ("ended after 0 of 2" in capsys.readouterr().err) == is_early


def test_active_var_asks_about_the_riskiest_state(tmp_path):
    asked = {}
    for strategy in ("active-var", "random"):
        out = tmp_path / strategy
        options = ("--steps", "5", "--num-queries", "1", "--strategy", strategy)
        assert run_driving(out, *options) == 0
        asked[strategy] = read_rows(out / "rounds.csv")[0]["query"]
    assert asked["active-var"] != asked["random"]
    riskiest = json.loads((tmp_path / "active-var" / "riskiest.json").read_text())
    first = riskiest["rounds"][0]["riskiest"][0]
    situation = shipped_drive("safe").highway.situations[int(asked["active-var"])]
    assert first["position"] == situation.agent
    assert first["cars"] == [list(car) for car in situation.cars]


def test_a_person_answers_until_the_window_is_closed(keys, tmp_path, capsys):
    keys += ["LEFT", "close"]
    out = tmp_path / "out"
    options = ("--steps", "5", "--num-queries", "4", "--answers", "person")
    assert run_driving(out, *options) == 0
    rows = read_rows(out / "rounds.csv")
    assert [row["answer"] for row in rows] == ["left", ""]
    assert "ended after 1 of 4 answers" in capsys.readouterr().err
    assert read_drive(out / "demos.json").driver == "safe, then person"


STUDY = DrivingStudyConfig(
    length=4, num_samples=60, num_sampled_states=30, num_queries=3
)


def test_who_drives_on_shows_the_next_steps_of_one_drive():
    rounds = list(islice(trials.rounds_of(STUDY, Trial("drive", 0)), 4))
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(0,)).spawn(2)[1])
    driven = drive(Highway(4), "safe", 8, rng=rng)
    assert len(rounds[0].demos[0].states) == 5
    known = Evidence.join(rounds[-1].demos)
    assert known.states.tolist() == list(driven.states)
    assert known.actions.tolist() == list(driven.actions)


def test_a_row_of_the_study_has_what_happened_on_the_road(monkeypatch):
    riskiest = Riskiest(np.array([3, 9]), np.array([0.2, 0.1]))
    monkeypatch.setattr(trials, "try_out", lambda *_, **__: Record(3, 7))
    monkeypatch.setattr(trials, "find_riskiest", lambda *_: riskiest)
    row = next(
        iter(trials.run_trial(replace(STUDY, num_queries=0), Trial("random", 0)))
    )
    road = Highway(4)
    spent = stationary_probabilities(road.mdp, road.driver_policy("safe"))
    assert (row["collisions"], row["off_road"]) == (3, 7)
    expected = pytest.approx(spent[[3, 9]].mean(), abs=1e-8)
    assert row["riskiest_probability"] == expected


def test_the_study_compares_by_ratios(tmp_path):
    out = tmp_path / "out"
    options = ["--num-trials", "2", "--num-queries", "1", "--length", "4", *FEW]
    argv = ["driving-study", *options, "--jobs", "1", "--out", str(out)]
    assert cli.main(argv) == 0
    rows = read_rows(out / "rounds.csv")
    for row in rows:
        is_asking = row["strategy"] == "active-var"
        row["collisions"] = 10 if is_asking else 20
        row["policy_loss"] = 0.1 if is_asking else 0.4
        row["riskiest_probability"] = 0.002 / (1 + 3 * int(row["num_queries"]))
    RunFolder(out).write_rows(rows)
    assert cli.main([*argv, "--resume"]) == 0
    told = (out / "comparison.md").read_text()
    assert "Probability after 1 more by that at first, drive: 0.2500" in told
    assert "Sum of collisions over all rounds, active-var by drive: 0.5000" in told
    assert "Sum of policy loss over all rounds, active-var by random: 0.2500" in told


def test_a_study_of_driving_has_the_same_rows_for_any_number_of_jobs(tmp_path):
    outs = [tmp_path / "one", tmp_path / "two"]
    for jobs, out in enumerate(outs, start=1):
        options = ["--num-trials", "2", "--num-queries", "1", "--length", "4"]
        argv = ["driving-study", *options, *FEW, "--jobs", str(jobs), "--out", str(out)]
        assert cli.main(argv) == 0

    def rows_of(out):
        return [
            {name: cell for name, cell in row.items() if "seconds" not in name}
            for row in read_rows(out / "rounds.csv")
        ]

    assert rows_of(outs[0]) == rows_of(outs[1])
    assert len(rows_of(outs[0])) == 12
    told = (outs[0] / "comparison.md").read_text()
    assert "| active-var | 1 |" in told
    assert "policy loss over all rounds, active-var by drive" in told
