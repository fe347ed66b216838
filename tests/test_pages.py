"""The commands of the pages for beginners and of the jobs run, in the order of the page."""

from __future__ import annotations

import doctest
import re
import shlex
from pathlib import Path

import pytest

from toolbox import catalog, reference
from toolbox.cli import arguments
from toolbox.cli.main import main
from toolbox.language import text

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = sorted(page for room in ("start", "jobs", "choose") for page in (DOCS / room).glob("*.md"))
PAGES += [DOCS / "howto" / name for name in ("deliver.md", "in-and-out.md")]
TURKISH = sorted((DOCS / "tr").rglob("*.md"))
FENCED = re.compile(r"^```(?:sh|python|console)\n.*?^```$", re.MULTILINE | re.DOTALL)
ITALIC = re.compile(r"\*([^*]+)\*")
PYTHON = re.compile(r"^```python\n(>>> .*?)^```", re.MULTILINE | re.DOTALL)


def test_a_command_may_take_several_lines_and_end_with_a_comment(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```sh\nrun a \\\n    --b 'c d'  # why\n```\n\n```console\nnot this\n```\n")
    assert reference.commands(page) == [["run", "a", "--b", "c d"]]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_commands_of_a_page_name_tools_and_their_options(page: Path) -> None:
    for words in reference.commands(page):
        if words[:4] == ["python", "-m", "toolbox", "run"]:
            described = catalog.describe(words[4])
            values, _ = arguments.read(described, words[5:])
            known = described["inputs"].keys() | described["outputs"].keys()
            known |= described.get("between", {}).keys()
            assert {name.partition(".")[0] for name in values} <= known, words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_commands_stand_in_blocks_that_are_run(page: Path) -> None:
    """A command with a file, in the middle of a sentence, would be run by nobody."""
    text = reference.SHELL.sub("", page.read_text("utf-8"))
    assert re.findall(r"`python\s+-m\s+toolbox\s+run\s+\S+\s[^`]*`", text) == []


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_commands_of_a_page_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TOOLBOX_HISTORY", str(tmp_path / "history.jsonl"))
    for words in reference.commands(page):
        if words[0] == "mkdir":
            Path(words[-1]).mkdir(parents=True, exist_ok=True)
        elif words[0] == "cp":
            (tmp_path / words[2] / words[1]).write_bytes(Path(words[1]).read_bytes())
        else:
            assert words[:3] == ["python", "-m", "toolbox"]
            code, said = main(words[3:]), capsys.readouterr().err
            assert code == 0, (words, said)
            assert "there is nothing to write" not in said, words


def in_english(page: Path) -> Path:
    """The page that a Turkish one translates."""
    inner = page.relative_to(DOCS / "tr")
    return DOCS / (inner if inner.parts[0] == "jobs" else Path("start", inner))


def test_jobs_and_the_first_quarter_of_an_hour_are_there_in_turkish() -> None:
    english = {*(DOCS / "jobs").glob("*.md"), DOCS / "start" / "first-quarter-hour.md"}
    assert {in_english(page) for page in TURKISH if page.stem != "index"} == english


@pytest.mark.parametrize("page", TURKISH, ids=lambda page: page.stem)
def test_a_turkish_page_has_the_commands_and_the_steps_of_the_english_one(page: Path) -> None:
    """So they need not run twice, and a step that is new in English is missed."""
    if page.stem == "index":
        return
    here, there = (one.read_text("utf-8") for one in (page, in_english(page)))
    assert FENCED.findall(here) == FENCED.findall(there)
    for mark in (r"(?m)^#+ ", r"(?m)^\|", r"(?m)^- ", r"(?m)^\d\. ", r"`--[\w-]+"):
        assert len(re.findall(mark, here)) == len(re.findall(mark, there)), mark


@pytest.mark.parametrize("language", ["en", "tr"])
def test_the_page_on_qgis_calls_tools_and_boxes_as_qgis_does(
    language: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOOLBOX_LANG", language)
    page = DOCS / ("tr/jobs" if language == "tr" else "jobs") / "in-qgis.md"
    rows = re.findall(r"(?m)^\| \[.*\| \*(.+)\* \| (.*) \| (.*) \|$", page.read_text("utf-8"))
    by_title = {text(one["title"]): one["id"] for one in catalog.summaries()}
    assert len(rows) == 5
    for title, *boxes in rows:
        described = catalog.describe(by_title[title])
        known = {text(one["title"]) for k in ("inputs", "outputs") for one in described[k].values()}
        assert {name for box in boxes for name in ITALIC.findall(box)} <= known
    steps = page.read_text("utf-8").partition("\n## ")[2]
    described = [catalog.describe(id) for id in by_title.values()]
    known = {
        text(f["title"])
        for one in described
        for k in ("inputs", "outputs")
        for f in one[k].values()
    }
    of_qgis = {"Folder to hand over", "Tile size", "Advanced Parameters"}
    of_qgis |= {text("Folder to hand over"), "Karo boyutu", "Gelişmiş Parametreler"}
    named = {" ".join(name.split()) for name in re.findall(r"(?<!\*)\*([^*]+)\*(?!\*)", steps)}
    assert len(named) > 10
    assert named <= known | by_title.keys() | of_qgis, named - known - by_title.keys() - of_qgis


WITH_PYTHON = [
    page
    for page in DOCS.rglob("*.md")
    if page not in TURKISH and PYTHON.search(page.read_text("utf-8"))
]


@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.stem)
def test_python_of_a_page_gives_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "\n".join(PYTHON.findall(page.read_text("utf-8")))
    said: list[str] = []
    examples = doctest.DocTestParser().get_doctest(text, {}, page.stem, str(page), 0)
    result = doctest.DocTestRunner(verbose=False).run(examples, out=said.append)
    assert result.attempted > 0
    assert result.failed == 0, "".join(said)


EXAMPLES = [(id, run) for id, runs in reference.examples().items() for run in runs]


@pytest.mark.parametrize(("id", "run"), EXAMPLES, ids=lambda value: str(value)[:30])
def test_an_example_gives_what_its_tool_takes(id: str, run: dict[str, object]) -> None:
    given = {name: value for name, value in run.items() if not name.startswith("$")}
    words = shlex.split(reference.as_words(given))
    values, general = arguments.read(catalog.describe(id), words)
    spec = catalog.load(id)
    inputs = {name: value for name, value in values.items() if name in spec.inputs}
    layers = [name for name in inputs if spec.inputs[name].role == "source"]
    settings = {name: value for name, value in inputs.items() if name not in layers}
    assert not general
    assert values.keys() <= spec.inputs.keys() | spec.results.keys()
    assert spec.parse(settings, present=layers)[1] == {}


def test_every_tool_of_the_examples_is_one() -> None:
    assert reference.examples().keys() <= set(catalog.own_ids())


def test_an_example_that_is_not_written_shows_what_a_tool_needs() -> None:
    runs = reference.runs_of(catalog.load("points.assign_crs"), None)
    text = reference.in_use("points.assign_crs", runs)
    assert "python -m toolbox run points.assign_crs --points points --crs crs" in text
