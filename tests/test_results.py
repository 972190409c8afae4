import json
import math
import os
import re
import shutil
from importlib.metadata import version

import numpy as np
import pytest

from tablesetting import __version__
from tablesetting.errors import InvalidFile, OutputError
from tablesetting.results import (
    CONFIG,
    CONFIG_FORMAT,
    ROUNDS,
    SUMMARY,
    RunFolder,
    numbers,
    package_versions,
    read_json,
    read_rows,
)


def create(path, *, overwrite=False):
    folder = RunFolder.make(path)
    with folder.locked():
        folder.clear(overwrite=overwrite)
    return folder


@pytest.fixture
def folder(tmp_path):
    return create(tmp_path / "run")


def names(folder):
    """List everything in a folder, hidden files as well."""
    return sorted(os.listdir(folder.path))


def save_half(path, error):
    path.write_text("half")
    raise error


def test_a_folder_is_made_with_its_parents(tmp_path):
    folder = create(tmp_path / "runs" / "vase" / "one")
    assert folder.path == tmp_path / "runs" / "vase" / "one"
    assert names(folder) == []


def test_an_empty_folder_is_taken_as_it_is(tmp_path):
    (tmp_path / "run").mkdir()
    assert names(create(tmp_path / "run")) == []


def test_what_a_kill_left_half_written_is_in_nobodys_way(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".123-config.json").write_text("{")
    assert names(create(tmp_path / "run")) == []


@pytest.mark.parametrize("name", [".2026-notes", ".config.json", "1-config.json"])
def test_a_file_of_somebody_else_is_not_taken_for_a_leftover(tmp_path, name):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / name).write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        create(tmp_path / "run")
    RunFolder(tmp_path / "run").remove_leftovers()
    assert names(RunFolder(tmp_path / "run")) == [name]


def test_leftovers_are_removed_from_all_of_a_run(folder):
    folder.write("figures/learning.png", lambda path: path.write_bytes(b"png"))
    (folder.path / "figures" / ".9-learning.png").write_bytes(b"p")
    (folder.path / ".9-rounds.csv").write_text("num")
    folder.remove_leftovers()
    assert names(folder) == ["figures"]
    assert os.listdir(folder.path / "figures") == ["learning.png"]


def test_a_locked_folder_is_locked_to_all_others(folder):
    folder.write_json(CONFIG, {"format": CONFIG_FORMAT})
    other = RunFolder(folder.path)
    with folder.locked():
        with pytest.raises(OutputError, match="another process is using"):
            other.locked().__enter__()
        with pytest.raises(OutputError, match="another process is using"):
            create(folder.path, overwrite=True)
    with other.locked():
        pass


def test_an_earlier_run_is_kept_unless_told(folder):
    folder.write_json(CONFIG, {"seed": 1})
    with pytest.raises(OutputError, match=r"run' exists already; choose another --out"):
        create(folder.path)
    assert names(folder) == [CONFIG]


def test_an_earlier_run_is_replaced_when_told(folder):
    folder.write_json(CONFIG, {"format": CONFIG_FORMAT})
    folder.write_json(SUMMARY, {})
    folder.write("figures/query_01.png", lambda path: path.write_text(""))
    assert names(create(folder.path, overwrite=True)) == []


@pytest.mark.parametrize("name", ["certificate.json", "audit.csv", "posterior.nc"])
def test_what_else_a_run_may_write_is_replaced_with_it(folder, name):
    folder.write_json(CONFIG, {"format": CONFIG_FORMAT})
    folder.write(name, lambda path: path.write_text(""))
    (folder.path / f".9-{name}").write_text("")
    assert names(create(folder.path, overwrite=True)) == []


@pytest.mark.parametrize("foreign", ["notes.txt", "figures/mine.png", "src/main.py"])
def test_a_run_with_something_else_in_its_folder_is_not_overwritten(folder, foreign):
    folder.write_json(CONFIG, {"format": CONFIG_FORMAT})
    (folder.path / foreign).parent.mkdir(exist_ok=True)
    (folder.path / foreign).write_text("mine")
    with pytest.raises(OutputError, match="which is not of a run"):
        create(folder.path, overwrite=True)
    assert (folder.path / foreign).read_text() == "mine"


def test_the_settings_of_another_program_make_no_run(folder):
    folder.write_json(CONFIG, {"model_type": "bert"})
    with pytest.raises(OutputError, match="it holds no run"):
        create(folder.path, overwrite=True)


def test_a_link_to_a_run_is_not_overwritten(folder, tmp_path):
    folder.write_json(CONFIG, {"format": CONFIG_FORMAT})
    (tmp_path / "link").symlink_to(folder.path)
    with pytest.raises(OutputError, match="it is a link"):
        create(tmp_path / "link", overwrite=True)
    assert names(folder) == [CONFIG]


def test_a_name_that_occurs_twice_is_refused(tmp_path):
    file = tmp_path / "twice.json"
    file.write_text('{"format": "f", "plate": 1, "plate": 2}')
    with pytest.raises(InvalidFile, match="'plate' occurs twice"):
        read_json(file, "f")


@pytest.mark.parametrize("overwrite", [False, True])
def test_what_is_not_a_run_is_never_overwritten(tmp_path, overwrite):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("years of work")
    (tmp_path / "file").write_text("more of it")
    refusal = "because it holds no run" if overwrite else "exists already"
    for name, message in (("thesis", refusal), ("file", "exists already")):
        with pytest.raises(OutputError, match=message):
            create(tmp_path / name, overwrite=overwrite)
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "years of work"
    assert (tmp_path / "file").read_text() == "more of it"


def test_a_folder_below_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/run': Not a directory; choose anoth"):
        create(tmp_path / "file" / "run")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_write_access_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="Permission denied; choose another --out"):
        create(tmp_path / "run")


def test_json_comes_back(folder):
    content = {"format": "this/1", "text": "gr\u00fc\u00df dich", "number": 0.1}
    folder.write_json(SUMMARY, content)
    assert read_json(folder.path / SUMMARY, "this/1") == content


def test_nan_is_not_written(folder):
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.write_json(SUMMARY, {"bound": math.nan})
    assert names(folder) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("no such colour")])
def test_nothing_half_written_remains_when_saving_is_cut_off(folder, error):
    folder.write_json("figure.json", {"version": 1})
    with pytest.raises(type(error)):
        folder.write("figure.json", lambda path: save_half(path, error))
    assert names(folder) == ["figure.json"]
    assert json.loads((folder.path / "figure.json").read_text()) == {"version": 1}


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "No space left on device"), "No space left on device"),
        (OSError("encoder failed"), "encoder failed"),
    ],
)
def test_a_failure_to_save_is_told_with_its_reason(folder, error, reason):
    message = rf"cannot write '.*run/a\.bin': {reason}; free some space"
    with pytest.raises(OutputError, match=message):
        folder.write("a.bin", lambda path: save_half(path, error))
    assert names(folder) == []


def test_a_file_in_the_place_of_a_folder_is_an_output_error(folder):
    (folder.path / "figures").write_text("")
    with pytest.raises(OutputError, match=r"cannot write '.*figures/a\.json'"):
        folder.write_json("figures/a.json", {})


def test_a_saver_sees_the_suffix_of_the_final_name(folder):
    seen = []
    folder.write("figures/a.png", lambda path: (seen.append(path), path.touch()))
    assert seen[0].suffix == ".png"
    assert seen[0].name != "a.png"
    assert os.listdir(folder.path / "figures") == ["a.png"]


def test_what_is_saved_under_its_final_name_is_never_seen_unfinished(folder):
    folder.write_json("a.json", {"version": 1})

    def save(path):
        path.write_text("half")
        assert json.loads((folder.path / "a.json").read_text()) == {"version": 1}
        path.write_text('{"version": 2}')

    folder.write("a.json", save)
    assert json.loads((folder.path / "a.json").read_text()) == {"version": 2}


def test_rows_come_back_as_text_below_one_header(folder):
    folder.append_rows([{"num_demos": 1, "failure": "", "error": 0.25}])
    quoted = 'slipped, "tilted"\n'
    folder.append_rows([{"num_demos": 2, "failure": quoted, "error": 1e-9}])
    assert read_rows(folder.path / ROUNDS) == [
        {"num_demos": "1", "failure": "", "error": "0.25"},
        {"num_demos": "2", "failure": 'slipped, "tilted"\n', "error": "1e-09"},
    ]


def test_rows_are_on_the_disk_at_once(folder):
    for count in (1, 2, 3):
        folder.append_rows([{"num_demos": count}])
        assert len(read_rows(folder.path / ROUNDS)) == count


def test_rows_of_other_columns_are_not_appended(folder):
    folder.append_rows([{"a": 1}])
    with pytest.raises(ValueError, match=r"has the columns \['a'\]; got \['b'\]"):
        folder.append_rows([{"b": 1}])
    assert read_rows(folder.path / ROUNDS) == [{"a": "1"}]


def test_a_table_can_be_written_anew(folder):
    folder.append_rows([{"a": 2}, {"a": 1}])
    folder.write_rows([{"a": 1}, {"a": 2}])
    assert read_rows(folder.path / ROUNDS) == [{"a": "1"}, {"a": "2"}]
    folder.write_rows([])
    assert read_rows(folder.path / ROUNDS) == []


def test_a_table_of_another_name_leaves_that_of_rounds_alone(folder):
    folder.append_rows([{"a": 1}])
    folder.write_rows([{"b": 2}], "audit.csv")
    assert read_rows(folder.path / "audit.csv") == [{"b": "2"}]
    assert read_rows(folder.path / ROUNDS) == [{"a": "1"}]


def test_a_row_that_cannot_be_written_is_told(folder):
    shutil.rmtree(folder.path)
    with pytest.raises(OutputError, match=r"cannot write '.*rounds\.csv'"):
        folder.append_rows([{"num_demos": 1}])


def test_numbers_are_a_column_with_nan_where_it_is_empty():
    rows = [{"a": "1", "b": "x"}, {"a": "", "b": "y"}, {"a": "-2.5e-3", "b": ""}]
    np.testing.assert_array_equal(numbers(rows, "a"), [1.0, math.nan, -0.0025])


@pytest.mark.parametrize("content", [None, b"a,b\n1,\xff\n", b"a\n" + b"1" * 200_000])
def test_what_is_no_table_is_refused(tmp_path, content):
    path = tmp_path / "rounds.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InvalidFile, match=re.escape(f"cannot read '{path}'")):
        read_rows(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot read '{}': No such file or directory; check the path"),
        (b"{", "'{}' is not valid JSON: "),
        (b"\xff", "'{}' is not valid JSON: "),
        (b"[" * 100_000, "'{}' is not valid JSON: "),
        (b"[]", "'{}' has the format None; expected 'this/1'"),
        (b'{"format": "that/1"}', "'{}' has the format 'that/1'; expected 'this/1'"),
    ],
)
def test_what_is_no_file_of_ours_is_refused(tmp_path, content, message):
    path = tmp_path / "file.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InvalidFile, match=re.escape(message.format(path))):
        read_json(path, "this/1")


def test_versions_name_every_package_that_results_depend_on():
    versions = package_versions()
    assert versions["tablesetting"] == __version__
    assert versions["mujoco"] == version("mujoco")
    assert set(versions) >= {"dm-control", "mink", "rerun-sdk", "numpy"}
