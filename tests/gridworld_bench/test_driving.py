import csv
import json

import numpy as np
import pytest
from refusals import refusal

from gridworld_bench import cli, window
from gridworld_bench.drives import read_drive, save_drive, shipped_drive
from gridworld_bench.highway import ACTIONS, DRIVERS, STAY

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


def test_nothing_driven_is_nothing_saved(keys, tmp_path, capsys):
    keys += ["close"]
    out = tmp_path / "demos.json"
    assert run_drive(out) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("driver", ["none at all", None])
def test_without_a_display_one_line_says_so(monkeypatch, tmp_path, capsys, driver):
    pygame = pytest.importorskip("pygame")
    if driver is None:
        monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
        monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
        monkeypatch.setattr(pygame.display, "init", lambda: None)
    else:
        monkeypatch.setenv("SDL_VIDEODRIVER", driver)
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
        ({"steps": []}, "`steps`"),
        ({"steps": [{"position": 9, "cars": [], "action": "left"}]}, "step 0"),
        ({"steps": [{"position": 2, "cars": [[1, 10]], "action": "left"}]}, "step 0"),
        ({"steps": [{"position": True, "cars": [], "action": "left"}]}, "step 0"),
        ({"steps": [{"position": 2, "cars": [], "action": "up"}]}, "step 0"),
        ({"steps": [{"position": 2, "cars": None, "action": "left"}]}, "step 0"),
        ({"steps": ["left"]}, "step 0"),
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


def run_driving(out, *options):
    return cli.main(["driving", *FEW, "--out", str(out), *map(str, options)])


def test_driving_writes_rows_pictures_and_a_recording(tmp_path, capsys):
    out = tmp_path / "out"
    assert run_driving(out, "--steps", "5", "8", "--num-queries", "2") == 0
    with (out / "rounds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["num_steps"], row["num_queries"]) for row in rows] == [
        ("5", "0"),
        ("8", "0"),
        ("8", "1"),
        ("8", "2"),
    ]
    assert [row["answer"] != "" for row in rows] == [False, True, True, False]
    assert (out / "figures" / "riskiest.png").stat().st_size > 10_000
    assert (out / "recording.rrd").stat().st_size > 10_000
    assert capsys.readouterr().out.count("| 8 |") == 3
    again = tmp_path / "again"
    assert run_driving(again, "--steps", "5", "8", "--num-queries", "2") == 0
    assert (again / "rounds.csv").read_bytes() == (out / "rounds.csv").read_bytes()
    refusal(capsys, cli.main, "driving", *FEW, "--out", out)
    assert run_driving(out, "--steps", "5", "--overwrite") == 0
    assert (out / "rounds.csv").read_bytes() != (again / "rounds.csv").read_bytes()


def test_questions_end_once_nothing_is_risky(tmp_path, capsys):
    options = ("--steps", "20", "--num-queries", "3", "--epsilon", "1000")
    assert run_driving(tmp_path / "out", *options) == 0
    assert "No more questions" in capsys.readouterr().out


def test_a_person_answers_until_the_window_is_closed(keys, tmp_path):
    keys += ["LEFT", "close"]
    out = tmp_path / "out"
    options = ("--steps", "5", "--num-queries", "4", "--answers", "person")
    assert run_driving(out, *options) == 0
    with (out / "rounds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["answer"] for row in rows] == ["left", ""]


def test_a_study_of_driving_has_the_same_rows_for_any_number_of_jobs(tmp_path):
    outs = [tmp_path / "one", tmp_path / "two"]
    for jobs, out in enumerate(outs, start=1):
        options = ["--num-trials", "2", "--num-queries", "1", "--length", "4"]
        argv = ["driving-study", *options, *FEW, "--jobs", str(jobs), "--out", str(out)]
        assert cli.main(argv) == 0

    def rows_of(out):
        with (out / "rounds.csv").open(newline="") as file:
            return [
                {name: cell for name, cell in row.items() if "seconds" not in name}
                for row in csv.DictReader(file)
            ]

    assert rows_of(outs[0]) == rows_of(outs[1])
    assert len(rows_of(outs[0])) == 12
