import json
import re
import runpy
import shlex
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gridworld_bench.experiments.config import CONFIGS
from gridworld_bench.experiments.driving_config import DRIVING_CONFIGS
from tablesetting import cli, command_line
from tablesetting.reward.files import read_demonstrations, read_layouts
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import FOOTPRINTS, VASE

ROOT = Path(__file__).parents[1]
parse_grid = partial(
    command_line.parse, configs=CONFIGS | DRIVING_CONFIGS, prog="", description=""
)
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))
TOLD = [ROOT / "docs" / "tutorial.md", *sorted((ROOT / "docs" / "howto").glob("*.md"))]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_runs_and_says_something(example, capsys):
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip()


def test_the_layout_file_of_the_docs_can_be_read(tmp_path):
    text = (ROOT / "docs" / "conventions.md").read_text()
    snippets = re.findall(r"```json\n(.*?)```", text, flags=re.DOTALL)
    file, demos_file = tmp_path / "layouts.json", tmp_path / "demonstrations.json"
    for path, snippet in zip((file, demos_file), snippets, strict=True):
        path.write_text(json.dumps(json.loads(snippet)))
    task, demos = read_demonstrations(demos_file)
    assert (task, len(demos)) == (VASE, 1)
    layouts = read_layouts(file, VASE.objects)
    np.testing.assert_array_equal(layouts, [VASE.first_layout])
    LayoutSpace.of_task(VASE, are_points=False).check(layouts[0])


def test_the_environments_of_the_docs_can_be_made():
    pytest.importorskip("gymnasium")
    text = (ROOT / "docs" / "arm.md").read_text()
    snippets = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(snippets) == 2
    for snippet in snippets:
        exec(snippet, {})


@pytest.mark.parametrize("page", TOLD, ids=lambda path: path.stem)
def test_the_snippets_of_a_page_run_one_after_the_other(
    page, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(FOOTPRINTS, "candle", FOOTPRINTS["cup"])  # Gone afterwards.
    snippets = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
    assert len(snippets) > 1
    names: dict[str, object] = {}
    for snippet in snippets:
        exec(snippet, names)
    assert capsys.readouterr().out.strip()


def test_the_reference_has_every_public_module():
    text = (ROOT / "docs" / "reference.md").read_text()
    listed = re.findall(r"automodule:: ([\w.]+)", text)
    found = [
        path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
        for package in ("tablesetting", "gridworld_bench")
        for path in (ROOT / package).rglob("*.py")
        if not path.stem.startswith("_") and path.parent.name != "__pycache__"
    ]
    assert set(listed) == set(found) - {"tablesetting.cli", "gridworld_bench.cli"}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_every_command_is_one_that_the_command_line_takes(page):
    text = "".join(re.findall(r"```sh\n(.*?)```", page.read_text(), flags=re.DOTALL))
    text = re.sub(r"\[.*?\]|#.*", "", text.replace("\\\n", " "))
    values = {"N": "3", "NAME": "cvar", "LIKELIHOOD": "auto", "TEACHER": "noisy"}
    for line in text.splitlines():
        program, *argv = shlex.split(line) or [""]
        parse = {"tablesetting": cli._parse, "gridworld-bench": parse_grid}
        name = Path(program).name
        if name in parse:
            parse[name]([values.get(word, word) for word in argv])


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_every_relative_link_leads_somewhere(page):
    links = re.findall(r"\]\(([^)#]+)", page.read_text())
    for link in links:
        if not link.startswith("http"):
            assert (page.parent / link).exists(), link
