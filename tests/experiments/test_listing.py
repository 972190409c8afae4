import json

import pytest

from tablesetting import cli
from tablesetting.errors import InvalidFile
from tablesetting.experiments.listing import list_runs

CONFIG = {"command": "run", "options": {"task": "vase", "strategy": "cvar", "seed": 7}}
SUMMARY = {
    "num_demos": 4,
    "mean_placement_error": 0.01234,
    "deployment_bound": 0.25,
    "certified": False,
}


def write(folder, **files):
    folder.mkdir(parents=True)
    for name, content in files.items():
        text = content if isinstance(content, str) else json.dumps(content)
        (folder / f"{name}.json").write_text(text)


def test_every_run_has_a_line_whatever_state_it_is_in(tmp_path):
    write(tmp_path / "a" / "done", config=CONFIG, summary=SUMMARY)
    write(tmp_path / "b", config=CONFIG)
    write(tmp_path / "c", config=CONFIG, summary='{"num_demos": ')
    write(tmp_path / "d", config="[1]", summary=SUMMARY | {"certified": True})
    errors = [{"mean_placement_error": error} for error in (0.02, 0.03)]
    validate = {"command": "validate", "options": {"seed": 1}}
    write(tmp_path / "e", config=validate, summary={"validated": errors})
    learn = CONFIG | {"command": "learn"}
    summary = {"num_demos": 5, "mean_prediction_error": 0.5, "certified": True}
    write(tmp_path / "f", config=learn, summary=summary)
    header, *lines = list_runs(tmp_path)
    assert header.split()[:3] == ["folder", "command", "task"]
    assert [" ".join(line.split()) for line in lines] == [
        "a/done run vase cvar 7 4 0.012 0.250 not certified",
        "b run vase cvar 7 - - - unfinished",
        "c run vase cvar 7 - - - damaged",
        "d - - - - 4 0.012 0.250 certified",
        "e validate - - 1 - 0.020,0.030 - finished",
        "f learn vase cvar 7 5 0.500 - certified",
    ]


def test_a_folder_without_runs_is_named(tmp_path):
    with pytest.raises(InvalidFile, match="holds none; name the folder of a run"):
        list(list_runs(tmp_path))


def test_options_of_a_single_run_are_refused_for_many(tmp_path, capsys):
    write(tmp_path / "a", config=CONFIG, summary=SUMMARY)
    shot = tmp_path / "shot.png"
    for options in (["--screenshot", str(shot)], ["--text"], ["--query", "2"]):
        assert cli.main(["inspect", str(tmp_path), *options]) == 2
        error = capsys.readouterr().err
        assert f"leave out {options[0]}" in error
        assert error.count("\n") == 1
    assert not shot.exists()
