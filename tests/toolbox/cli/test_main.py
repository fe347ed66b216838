"""The command line as a user and as a calling program meet it: real processes, real files."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import cloud

from toolbox import catalog
from toolbox.cli import arguments
from toolbox.cli.console import Console, Events
from toolbox.cli.main import main
from toolbox.data import PointCloud, Raster, Table
from toolbox.data.crs import LOCAL

HEAVY = ("numba", "scipy", "geopandas", "rasterio", "sklearn", "numpy", "pyproj", "pandas")


@pytest.fixture
def town(tmp_path: Path) -> Path:
    """A few hundred points with intensity and returns, in a projected CRS."""
    rng = np.random.default_rng(0)
    n = 500
    xyz = np.column_stack([rng.uniform(0, 40, n) + 5e5, rng.uniform(0, 40, n) + 4.6e6, np.zeros(n)])
    columns = {
        "intensity": np.arange(n, dtype=np.uint16),
        "classification": np.full(n, 2, np.uint8),
    }
    path = tmp_path / "town.laz"
    PointCloud(xyz.round(2), columns, crs=CRS(32635)).save(path)
    return path


def run(*arguments: Any, **how: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "toolbox", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, **how)


def test_list_describe_and_help_import_no_numerical_library() -> None:
    code = f"""
import sys
from toolbox.cli.main import main
main(["list"]); main(["describe", "ground.csf"]); main(["describe", "ground.csf", "--json"])
try:
    main(["run", "ground.csf", "--help"])
except SystemExit:
    pass
sys.exit(", ".join(name for name in {HEAVY!r} if name in sys.modules) or 0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.returncode == 0
    assert "--cloth_resolution" in done.stdout


def test_running_imports_no_library_before_a_tool_or_a_format_needs_it() -> None:
    """Each of these would add a tenth to half of a second to every command."""
    lazy = set(HEAVY) - {"numpy", "pyproj"}
    code = f"import sys, toolbox.execute; sys.exit(', '.join({lazy!r} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_model_of_points_and_rasters_loads_no_library_for_tables() -> None:
    """Nor for search trees: its step for water needs them, and is off unless it is asked for."""
    lazy = {"geopandas", "pandas", "scipy.spatial", "scipy.sparse"}
    code = (
        "import sys; from toolbox import catalog; catalog.load('models.terrain'); "
        f"sys.exit(', '.join({lazy!r} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_help_ends_with_two_commands_that_a_terminal_holds_and_a_shell_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for id in ("models.terrain", "points.filter"):
        with pytest.raises(SystemExit):
            main(["run", id, "--help"])
        text = capsys.readouterr().out.partition("\nexamples:\n")[2]
        assert max(map(len, text.splitlines())) <= 80
        commands = [shlex.split(one) for one in text.replace("\\\n", "").splitlines()]
        assert len(commands) == 2
        for words in commands:
            assert words[:5] == ["python", "-m", "toolbox", "run", id]
            arguments.parser(catalog.describe(id)).parse_args(words[5:])


def test_help_of_a_tool_begins_with_what_must_be_given(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With either way to ask for it."""
    for asked in (["run", "corridor.clearance", "--help"], ["help", "corridor.clearance"]):
        with pytest.raises(SystemExit):
            main(asked)
        text = capsys.readouterr().out
        usage = (
            "usage: python -m toolbox run corridor.clearance --points ... --wires ... [options]\n"
        )
        assert text.startswith(usage)


def test_help_has_the_usual_options_and_help_all_every_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def said(*words: str) -> str:
        with pytest.raises(SystemExit):
            main([*words])
        return capsys.readouterr().out

    short = said("run", "models.terrain", "--help")
    for option in ("--points ", "--contour_length ", "--dtm ", "--page ", "--deliver ", "--help "):
        assert f"\n  {option}" in short.replace("-h [all], ", "")
    for option in ("--points.columns", "--dtm.cog", "--lines.contours", "--workers", "steps:"):
        assert option not in short
    whole = said("run", "models.terrain", "--help", "all")
    for option in ("--points.columns", "--dtm.cog", "--lines.contours", "--workers", "steps:"):
        assert option in whole
    assert said("run", "models.terrain", "--cell", "--help=all") == whole
    assert said("help", "models.terrain") == short
    assert said("help", "models.terrain", "all") == whole
    assert main(["describe", "models.terrain"]) == 0
    assert capsys.readouterr().out == whole


def test_list_and_describe(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    assert "surface.grid" in capsys.readouterr().out
    assert main(["list", "--json"]) == 0
    assert {"id", "title"} <= json.loads(capsys.readouterr().out)[0].keys()
    assert main(["describe", "surface.grid", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["id"] == "surface.grid"
    assert main(["describe", "surface.gird"]) == 2
    assert "did you mean 'surface.grid'?" in capsys.readouterr().err


def test_run_writes_outputs_and_prints_values(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "kept.laz"
    argv = ["run", "points.filter-intensity".replace("-", "_"), "--points", str(town)]
    assert main([*argv, "--minimum", "100", "--kept", str(out)]) == 0
    path, share, threshold = capsys.readouterr().out.splitlines()
    assert path == f"kept: {out}  (points: 400)"
    assert share == "removed_share: 20 %  (share of points removed)"
    assert threshold.startswith("threshold: 100  (")
    assert len(PointCloud.open(out)) == 400


def test_json_result(town: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "points.info", "--points", str(town), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["id"] == "points.info"
    assert result["statistics"]["count"] == 500
    assert {"property": "points", "value": 500, "unit": ""} in result["outputs"]["table"]


def test_info_of_every_sort_of_file(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dtm = tmp_path / "dtm.tif"
    assert main(["run", "surface.grid", "--points", str(town), "--surface", str(dtm)]) == 0
    capsys.readouterr()
    for path, word in [(town, "intensity percentile 50"), (dtm, "band 1 mean")]:
        assert main(["info", str(path)]) == 0
        assert word in capsys.readouterr().out
    assert main(["info", str(tmp_path / "no.laz")]) == 2
    (tmp_path / "empty").mkdir()
    assert main(["info", str(tmp_path / "empty")]) == 3


def test_sources_of_several_files(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A list, a pattern or a folder in place of a path; without one, or with one too much."""
    other = tmp_path / "u.laz"
    PointCloud.open(town).save(other)
    kept = tmp_path / "kept.laz"
    for places in ([town, other], [tmp_path], [tmp_path / "*.laz"]):
        argv = ["run", "points.filter", "--points", *map(str, places), "--points.bounds"]
        assert main([*argv, "5e5,4.6e6,6e5,5e6", "--kept", str(kept), "--overwrite"]) == 0
        assert len(PointCloud.open(kept)) == 1000
        kept.unlink()
    capsys.readouterr()
    assert main(["info", str(town), str(other)]) == 0
    assert "files " in capsys.readouterr().out
    assert main(["info", str(tmp_path)]) == 0
    assert "files " in capsys.readouterr().out
    assert main(["info", str(town), str(tmp_path / "no.laz")]) == 2
    assert "there is no file" in capsys.readouterr().err
    argv = ["run", "points.filter", "--points", str(tmp_path / "no.laz"), str(town)]
    assert main([*argv, str(tmp_path / "no2.laz")]) == 2
    assert re.search(r"no file .*no\.laz, .*no2\.laz", capsys.readouterr().err)
    argv = ["run", "points.filter", "--points", str(tmp_path), "--kept", str(other)]
    assert main([*argv, "--overwrite"]) == 2
    assert "is also an input" in capsys.readouterr().err


def test_options_may_be_written_with_dashes_and_negative_values(
    town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["run", "points.filter", "--points", str(town), "--elevation-above-lowest", "-1,1"]
    assert main([*argv, "--points.bounds", "-5,-5,9e5,9e6"]) == 0
    assert "kept" in capsys.readouterr().out


def test_all_problems_are_reported_at_once(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["run", "surface.grid", "--points", str(tmp_path / "no.laz"), "--cell", "-1"]
    argv += ["--methd", "idw", "--surface", str(tmp_path / "no" / "a.tif"), "--power", "x"]
    assert main(argv) == 2
    error = capsys.readouterr().err
    for text in [
        "surface.grid: 5 problems",
        "cell: must be > 0 and <= 10000 m, got -1.0",
        "methd: unknown parameter; did you mean 'method'?",
        "points: there is no file",
        "power: must be a number, got 'x'",
        "surface: there is no folder",
    ]:
        assert text in error


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--cell", "1", "--cell", "2"], "cell: given more than once"),
        (["stray"], "stray"),
        (["--metho", "idw"], "metho: unknown parameter; did you mean 'method'?"),
        (["--filled_share", "a.csv"], "filled_share"),
        (["--surface", "https://example.org/a.tif"], "surface: nothing is written to the web"),
        (["--points.colums", "x"], "points: no option 'colums'; there are columns"),
        (["--cell"], "expected one argument"),
        (["--events", "xml"], "invalid choice"),
        (["--assume-crs", "EPSG:1"], "assume_crs"),
        (["--picture", "a.jpg"], "use .png"),
        (["--params", "no.json"], "params: cannot read no.json"),
    ],
)
def test_wrong_arguments(
    town: Path, arguments: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "surface.grid", "--points", str(town), *arguments]) == 2
    assert text in "".join(capsys.readouterr())


def test_harmful_outputs_are_refused(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["run", "points.filter", "--points", str(town)]
    before = town.read_bytes()
    assert main([*argv, "--kept", str(town), "--overwrite"]) == 2
    assert "also an input" in capsys.readouterr().err
    assert main([*argv, "--kept", str(tmp_path / "k.laz")]) == 0
    assert main([*argv, "--kept", str(tmp_path / "k.laz")]) == 2
    assert main([*argv, "--kept", str(tmp_path / "k.laz"), "--overwrite"]) == 0
    assert town.read_bytes() == before


def test_unreadable_data_is_another_code_than_wrong_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.laz"
    bad.write_bytes(b"not a point cloud")
    out = tmp_path / "out.laz"
    assert main(["run", "points.filter", "--points", str(bad), "--kept", str(out)]) == 3
    assert "bad.laz" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.laz"]


def test_a_reader_that_has_gone_is_no_mistake() -> None:
    shell = f"{sys.executable} -m toolbox list | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, check=False)
    assert done.returncode == 141
    assert done.stderr == ""


def test_missing_crs_says_what_to_do(
    tmp_path: Path, town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "bare.laz"
    PointCloud.open(town).with_crs(None).save(bare)
    argv = ["run", "surface.grid", "--points", str(bare), "--surface", str(tmp_path / "s.tif")]
    assert main(argv) == 3
    assert "--assume-crs" in capsys.readouterr().err
    assert main([*argv, "--assume-crs", "local"]) == 0
    assert Raster.open(tmp_path / "s.tif").crs == LOCAL
    assert main([*argv, "--assume-crs", "EPSG:32635", "--overwrite"]) == 0
    assert Raster.open(tmp_path / "s.tif").crs == CRS(32635)
    assert main(["run", "points.filter", "--points", str(bare)]) == 0
    assert "warning" in capsys.readouterr().err


@pytest.mark.parametrize("text", ['{"cell": 2, "classes": [2]}', "cell: 2\nclasses: '2'"])
def test_params_from_a_file(
    town: Path, tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "p.yaml"
    params.write_text(text)
    out = tmp_path / "s.tif"
    argv = ["run", "surface.grid", "--points", str(town), "--params", str(params)]
    assert main([*argv, "--surface", str(out)]) == 0
    assert Raster.open(out).cell == 2
    assert main([*argv, "--surface", str(out), "--cell", "4", "--overwrite"]) == 0
    assert Raster.open(out).cell == 4, "the command line wins over the file"
    assert capsys.readouterr().err == ""


def test_a_switch_of_a_run_takes_no_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "points.filter", "--overwrite=3"]) == 2
    assert "--overwrite takes no value, got '3'" in capsys.readouterr().err


def test_options_of_a_source_join_a_path_from_a_file(tmp_path: Path) -> None:
    text, params = tmp_path / "a.txt", tmp_path / "p.json"
    text.write_text("1 2 3 9\n4 5 6 8\n")
    params.write_text(json.dumps({"points": str(text)}))
    argv = ["run", "points.filter", "--params", str(params), "--where", "-user_data<-8.5"]
    assert main([*argv, "--points.columns", "x,y,z,user_data"]) == 0


def test_an_output_may_say_how_to_write_it(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["run", "surface.grid", "--points", str(town), "--surface", str(tmp_path / "s.tif")]
    assert main([*argv, "--surface.cog", "perhaps"]) == 2
    assert main([*argv, "--surface.cog", "true"]) == 0
    assert b"LAYOUT=IFDS_BEFORE_DATA" in (tmp_path / "s.tif").read_bytes()[:400]
    assert capsys.readouterr().err.count(" problem") == 1


def test_names_that_stand_twice_in_a_file_are_refused(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "p.json"
    argv = ["run", "surface.grid", "--points", str(town), "--params", str(params)]
    for text in ('{"cell": 1, "cell": 2}', "cell: 1\ncell: 2"):
        params.write_text(text)
        assert main(argv) == 2
        assert "'cell' is given more than once" in capsys.readouterr().err
    for text in ("where: [", "[" * 5000, '{"cell": 1' + "0" * 5000 + "}"):
        params.write_text(text)
        assert main(argv) == 2
        assert "params: " in capsys.readouterr().err


def test_params_from_stdin(town: Path) -> None:
    text = json.dumps({"points": str(town)})
    done = run("run", "points.info", "--params", "-", "--json", input=text)
    assert done.returncode == 0
    assert json.loads(done.stdout)["statistics"]["count"] == 500


def test_mistakes_of_ours_are_code_1(
    town: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("secret")

    monkeypatch.setattr("toolbox.execute.run", broken)
    assert main(["run", "points.info", "--points", str(town)]) == 1
    assert "Traceback" not in capsys.readouterr().err
    assert main(["run", "points.info", "--points", str(town), "--verbose"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error", [FileNotFoundError(2, "No such file", "gone/k.laz"), OSError(28, "full")]
)
def test_what_the_system_refuses_is_no_mistake_of_ours(
    error: OSError, town: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*args: object, **how: object) -> None:
        raise error

    monkeypatch.setattr("toolbox.execute.run", refused)
    assert main(["run", "points.info", "--points", str(town)]) == 3
    said = capsys.readouterr().err
    assert said == f"error: {error.filename or 'cannot read or write'}: {error.strerror}\n"


def test_want_of_memory_is_no_mistake(
    town: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def greedy(*_: Any, **__: Any) -> None:
        raise MemoryError("Unable to allocate 7 TiB")

    monkeypatch.setattr("toolbox.runs.source.opened", greedy)
    assert main(["run", "points.info", "--points", str(town)]) == 3
    assert capsys.readouterr().err.startswith("error: not enough memory (Unable to allocate 7 TiB)")


def test_a_library_that_cannot_be_loaded_is_no_mistake(
    town: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As numba, where an address space is too small for it."""

    def absent(name: str) -> None:
        raise OSError("failed to map segment from shared object")

    monkeypatch.setattr("toolbox.catalog.importlib.import_module", absent)
    assert main(["run", "points.info", "--points", str(town)]) == 3
    assert "points.info cannot be loaded; is there enough memory" in capsys.readouterr().err


SLOW = """
import sys, time
import toolbox.execute
from toolbox import files

def slow(id, values, *, ctx, **how):
    kept = __import__("pathlib").Path(values["kept"])
    with files.staged({{kept: lambda path: (path,)}}, overwrite=False) as places:
        for path in places.values():
            path.write_text("half")
        for step in range(600):
            time.sleep({pause}) if {stubborn} else ctx.progress(step / 600)
            time.sleep(0.05)

toolbox.execute.run = slow
from toolbox.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def start(tmp_path: Path, town: Path, *more: str, stubborn: bool = False) -> Any:
    code = SLOW.format(pause=30, stubborn=stubborn)
    argv = ["run", "points.filter", "--points", str(town), "--kept", str(tmp_path / "k.laz")]
    pipe = subprocess.PIPE
    child = subprocess.Popen(
        [sys.executable, "-c", code, *argv, *more], stdin=pipe, stdout=pipe, stderr=pipe
    )
    for _ in range(400):
        if list(tmp_path.glob(".unfinished-*/new/k.laz")):
            return child
        time.sleep(0.05)
    raise AssertionError(child.communicate())


def interrupt(child: Any) -> None:
    child.send_signal(signal.SIGINT)


def terminate(child: Any) -> None:
    child.send_signal(signal.SIGTERM)


def close_pipe(child: Any) -> None:
    child.stdin.close()
    child.stdin = None


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("stubborn", [False, True], ids=["asks", "never asks"])
@pytest.mark.parametrize("stop", [interrupt, terminate, close_pipe])
def test_stopping_leaves_nothing(
    tmp_path: Path, town: Path, stop: Callable[[Any], None], stubborn: bool
) -> None:
    child = start(tmp_path, town, "--events", "jsonl", stubborn=stubborn)
    stop(child)
    events, _ = child.communicate(timeout=10)
    assert child.returncode == 130
    assert json.loads(events.splitlines()[-1]) == {
        "event": "error",
        "code": 130,
        "message": "cancelled",
    }
    assert [p.name for p in tmp_path.iterdir()] == ["town.laz"]


def test_events_for_programs(town: Path, tmp_path: Path) -> None:
    out = tmp_path / "kept.laz"
    params = json.dumps({"points": str(town), "kept": str(out), "minimum": 100})
    protocol = ["--params", "-", "--events", "jsonl"]
    child = subprocess.Popen(
        [sys.executable, "-m", "toolbox", "run", "points.filter_intensity", *protocol],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdin
    assert child.stdout
    child.stdin.write(params + "\n")
    child.stdin.flush()
    events = [json.loads(line) for line in child.stdout]
    child.stdin.close()
    assert child.wait(10) == 0
    assert events[-1] == {
        "event": "result",
        "outputs": {"kept": str(out), "removed_share": 0.2, "threshold": 100},
    }
    percents = [event["value"] for event in events if event["event"] == "progress"]
    assert percents == sorted(set(percents))
    assert percents[-1] == 100
    child.stdout.close()
    if child.stderr:
        child.stderr.close()


def test_events_carry_errors(town: Path) -> None:
    done = run("run", "points.filter", "--params", "-", "--events", "jsonl", input="[]\n")
    assert done.returncode == 2
    assert json.loads(done.stdout)["event"] == "error"
    assert json.loads(done.stdout)["code"] == 2
    done = run("run", "points.filter", "--points", "--events", "jsonl", stdin=subprocess.DEVNULL)
    assert done.returncode == 2
    assert "expected at least one argument" in json.loads(done.stdout)["message"]


def shell(line: str, town: Path) -> subprocess.CompletedProcess[str]:
    command = f'"{sys.executable}" -m toolbox {line}'
    how: dict[str, Any] = {"capture_output": True, "text": True, "cwd": town.parent}
    return subprocess.run(["sh", "-c", command], timeout=120, check=False, **how)


KEEP = "run points.filter --points town.laz --kept k.laz"


@pytest.mark.skipif(os.name == "nt", reason="needs a shell with streams that can be closed")
@pytest.mark.parametrize("ending", [">&-", "2>&-", ">&- 2>&-", ">&- --events jsonl"])
def test_a_closed_stream_is_refused_before_anything_is_done(town: Path, ending: str) -> None:
    """The next file would get its number, and hold what a library prints."""
    done = shell(f"{KEEP} {ending}", town)
    assert done.returncode == 2
    if ending != ">&- 2>&-":
        assert "closed; direct it to a file" in done.stdout + done.stderr
    assert not (town.parent / "k.laz").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize("line", ["list", "list --json", "run points.info --points town.laz", KEEP])
def test_a_result_that_cannot_be_printed_is_an_error(town: Path, line: str) -> None:
    done = shell(f"{line} >/dev/full", town)
    assert done.returncode == 3
    assert done.stderr.splitlines()[-1].startswith("error: ")
    assert "No space left" in done.stderr
    assert "mistake" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_events_that_cannot_be_printed_end_the_run(town: Path) -> None:
    done = shell(f"{KEEP} --events jsonl >/dev/full", town)
    assert done.returncode == 3
    assert done.stderr == "error: standard output cannot be written: No space left on device\n"
    assert not (town.parent / "k.laz").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_errors_that_cannot_be_printed_are_told_by_the_exit_code(town: Path) -> None:
    assert shell("run points.info --points none.laz 2>/dev/full", town).returncode == 2


LONG = "x" * 300


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (f"run points.filter --points town.laz --kept {LONG}.laz", 2),
        (f"run points.filter --points town.laz --kept {LONG}/k.laz", 2),
        (f"run points.filter --points town.laz --kept {'x' * 248}.csv", 2),  # its record is longer
        (f"run surface.grid --points town.laz --surface {LONG}.tif --picture {LONG}.png", 2),
        (f"run points.filter --points {LONG}.laz --kept k.laz", 2),
        (f"batch points.info town.csv --result {LONG}.csv", 2),
        (f"info {LONG}.laz", 3),
        (f"provenance {LONG}.laz", 3),
    ],
)
def test_names_that_no_file_can_have(
    town: Path,
    line: str,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(town.parent)
    (town.parent / "town.csv").write_text("points\ntown.laz\n")
    assert main(line.split()) == code
    assert "File name too long" in capsys.readouterr().err


def test_head_of_a_long_list_is_no_error() -> None:
    command = f"{sys.executable} -m toolbox list | true"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_letters_that_the_encoding_has_not_end_no_run() -> None:
    env = os.environ | {"PYTHONIOENCODING": "ascii", "TOOLBOX_LANG": "tr"}
    done = run("list", "ground.csf", env=env)
    assert (done.returncode, done.stderr) == (0, "")
    assert "zemini s\\u0131n\\u0131fland\\u0131r\\u0131r" in done.stdout


def test_quiet_prints_errors_and_what_is_asked_for_as_json(
    town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["run", "points.info", "--points", str(town), "--quiet"]
    assert main(argv) == 0
    assert capsys.readouterr() == ("", "")
    assert main([*argv, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["statistics"]["count"] == 500
    Events("quiet").result({"id": "a.b"}, {"count": 500})
    assert json.loads(capsys.readouterr().out)["outputs"] == {"count": 500}
    assert main(["run", "points.info", "--points", "no.laz", "--quiet"]) == 2
    assert "there is no file no.laz" in capsys.readouterr().err


@pytest.mark.parametrize("how", ["json", "events"])
def test_json_has_null_for_what_is_no_number(how: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A table of a tool may hold NaN and infinity, which JSON does not have."""
    table = Table.from_rows([{"value": float("nan")}, {"value": float("inf")}])
    made = Events() if how == "events" else Console(as_json=True)
    made.result({"id": "a.b"}, {"table": table, "bias": float("nan"), "some": (1.0, np.inf)})

    def refused(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(capsys.readouterr().out, parse_constant=refused)
    found = {**found["outputs"], **found.get("statistics", {})}
    assert found["table"] == [{"value": None}, {"value": None}]
    assert found["bias"] is None
    assert found["some"] == [1.0, None]


def test_a_run_that_saves_nothing_says_so_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "a.laz"
    cloud([[x, y, 1] for x in range(4) for y in range(4)]).save(points)
    said = ["run", "surface.grid", "--points", str(points)]
    assert main(said) == 0
    found = capsys.readouterr()
    assert found.err.startswith("nothing will be saved; to keep a result: --surface PATH")
    assert "filled_share: 100 %  (share of cells with a value)\n" in found.out
    assert main([*said, "--surface", str(tmp_path / "a.tif")]) == 0
    assert main([*said, "--page", str(tmp_path / "a.html")]) == 0
    assert main([*said, "--json"]) == 0
    assert main(["run", "points.info", "--points", str(points)]) == 0  # whose table is printed
    assert "nothing will be saved" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--method", "max", "9"], "several values of an option have commas between them"),
        (["a.laz"], "did you mean --points a.laz?"),
        (["--classes", "ground"], "'ground' is no class or range of classes; did you mean 2?"),
    ],
)
def test_what_is_nearly_right_is_answered_with_what_is(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "surface.grid", *words]) == 2
    assert says in capsys.readouterr().err


def test_a_tool_where_a_verb_belongs_is_answered_with_the_verb(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["surface.grid", "--cell", "1"]) == 2
    assert "surface.grid is a tool; did you mean 'run surface.grid'?" in capsys.readouterr().err


def test_help_has_units_and_the_name_that_was_given(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", "surface.contours", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("usage: python -m toolbox run surface.contours --surface ... [options]")
    assert "Height of one of the lines [m] (default 0.0)" in said
    assert "height between two lines [> 0 m] (default" in said
    with pytest.raises(SystemExit):
        main(["run", "points.filter", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "must be met [heights and all attributes in the units of the data]" in said


def test_the_first_command_says_that_it_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    run = ["run", "points.info", "--points", "absent.laz"]
    main(run)
    assert "compiling loops, once" in capsys.readouterr().err
    main([*run, "--json"])
    assert "compiling loops" not in capsys.readouterr().err
    (tmp_path / "a.nbi").touch()
    main(run)
    assert "compiling loops" not in capsys.readouterr().err
