"""The plugin without QGIS: what it reads, how it is put together, installed and looked after."""

from __future__ import annotations

import ast
import hashlib
import json
import sys
import zipfile
from pathlib import Path

import pytest

from toolbox import __version__, catalog
from toolbox.cli.main import main
from toolbox.qgis import install as qgis_install
from toolbox.qgis import process as qgis_process
from toolbox.qgis import published
from toolbox.qgis import tools as qgis_tools
from toolbox.qgis.install import SOURCE, switched_on

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def listed() -> dict[str, dict[str, object]]:
    return {tool["id"]: tool for tool in qgis_tools.listing()["tools"]}


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("package") / "plugin.zip"
    qgis_install.package(path)
    return path


def test_every_tool_and_model_is_listed_under_a_name_of_its_own(
    listed: dict[str, dict[str, object]],
) -> None:
    assert list(listed) == catalog.ids()
    names = {str(tool["algorithm"]) for tool in listed.values()}
    assert len(names) == len(listed)
    assert all(name.isalnum() and name.islower() for name in names)
    assert qgis_tools.names()["pointsheightaboveground"] == "points.height_above_ground"


def test_fields_say_which_widget_they_need(listed: dict[str, dict[str, object]]) -> None:
    def field(tool: str, name: str, where: str = "inputs") -> dict[str, object]:
        return next(f for f in listed[tool][where] if f["name"] == name)  # type: ignore[attr-defined]

    cell = field("surface.grid", "cell")
    assert (cell["type"], cell["default"], cell["gt"]) == ("length", 1.0, 0)
    assert field("shoreline.alpha_shape", "alpha")["type"] == "text"  # a length or "auto"
    assert field("points.thin", "dimensions")["choices"] == ["3", "2"]
    assert field("features.local", "features")["many"] is True
    classes = field("surface.grid", "classes")
    assert classes["type"] == "classes"
    assert [2, "Ground"] in classes["known"]  # type: ignore[operator]
    assert field("compare.classes", "attribute")["of"] == ["points"]
    assert field("compare.classes", "other_attribute")["of"] == ["points"]  # the first layer
    assert field("compare.rasters", "class_attribute")["of"] == ["areas", "checkpoints"]
    assert field("shoreline.alpha_shape", "alpha")["offers"] == ["auto", "all_points"]
    assert field("points.filter", "where")["type"] == "condition"
    assert field("points.reproject", "geoid")["type"] == "file"
    assert field("models.terrain", "deliver", "outputs")["type"] == "folder"
    assert field("points.clip", "extent")["type"] == "extent"
    assert field("points.merge", "points")["type"] == "pointcloud"
    assert field("compare.classes", "table", "outputs")["type"] == "table"
    assert field("compare.classes", "kappa", "outputs")["type"] == "number"
    assert field("surface.grid", "tile")["option"] == "tile"
    assert field("surface.grid", "resume")["default"] is False
    shown = {name: field("surface.grid", name)["advanced"] for name in ("points", "cell", "power")}
    assert shown == {"points": False, "cell": False, "power": True}
    assert not [f for f in listed["surface.hillshade"]["inputs"] if f["name"] == "tile"]  # type: ignore[attr-defined]
    first = [f["name"] for f in listed["compare.classes"]["outputs"] if f.get("first")]  # type: ignore[attr-defined]
    assert first == ["table"]


def test_each_language_has_its_own_list_help_and_texts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    made = qgis_install.contents()
    english, turkish = (json.loads(made[name]) for name in ("tools.json", "tools.tr.json"))
    lists = (english["tools"], turkish["tools"])
    titles = [next(t for t in tools if t["id"] == "surface.grid") for tools in lists]
    assert [t["title"] for t in titles] == [
        "Grid points to a raster",
        "Noktaları raster olarak gridle",
    ]
    assert [f["name"] for f in titles[0]["inputs"]] == [f["name"] for f in titles[1]["inputs"]]
    assert "Girdi parametreleri" in made["help/surface.grid.tr.html"]
    assert 'lang="tr"' in made["help/surface.grid.tr.html"]
    assert "Input parameters" in made["help/surface.grid.html"]
    assert json.loads(made["texts.tr.json"])["Choose…"] == "Seç…"


def test_the_plugin_imports_qgis_and_the_standard_library_alone() -> None:
    # A plugin that QGIS brings along, and the GDAL that both of them need.
    allowed = {*sys.stdlib_module_names, "qgis", "processing", "osgeo"}
    for path in SOURCE.glob("*.py"):
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text, feature_version=(3, 9))):  # that of older QGIS
            if isinstance(node, ast.Import):
                assert {a.name.partition(".")[0] for a in node.names} <= allowed, path.name
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                assert str(node.module).partition(".")[0] in allowed, path.name


def test_each_group_has_an_icon() -> None:
    """A simple drawing, toolbox/qgis/plugin/icons/GROUP.svg, for a new group too."""
    groups = {tool["group_id"] for tool in qgis_tools.listing()["tools"]}
    assert {path.stem for path in (SOURCE / "icons").iterdir()} == groups
    assert {f"icons/{group}.svg" for group in groups} <= set(qgis_install.contents())


def test_a_package_brings_a_wheel_with_hashes(tmp_path: Path, capsys: Capture) -> None:
    path, wheel = tmp_path / "plugin.zip", tmp_path / f"lidar_toolbox-{__version__}-py3-any.whl"
    wheel.write_bytes(b"a wheel")
    needs = tmp_path / "needs.txt"
    needs.write_text("# what it needs\nnumpy==2.0 \\\n    --hash=sha256:ab\nlaspy==2.5\n")
    words = ["qgis", "package", str(path), "--needs", str(needs)]
    assert main(words) == 2
    assert main([*words, "--wheel", str(wheel)]) == 3
    assert "laspy==2.5 has no hash" in capsys.readouterr().err
    assert main([*words, "--wheel", str(tmp_path / "other-1-py3-any.whl")]) == 3
    assert "is no wheel of lidar-toolbox" in capsys.readouterr().err
    needs.write_text("numpy==2.0 \\\n    --hash=sha256:ab\n")
    assert main([*words, "--wheel", str(wheel)]) == 0
    with zipfile.ZipFile(path) as archive:
        packed = archive.read(f"lidar_toolbox/wheel/{wheel.name}")
        said = archive.read("lidar_toolbox/wheel/SHA256").decode().split()
        assert archive.read("lidar_toolbox/wheel/requirements.txt") == needs.read_bytes()
    assert packed == b"a wheel"
    assert said == [hashlib.sha256(b"a wheel").hexdigest(), wheel.name]


def test_package_is_what_the_plugin_site_takes(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "plugin.zip"
    assert main(["qgis", "package", str(path)]) == 0
    told = capsys.readouterr().out
    assert "plugin.zip" in told
    missing = [published.KEYS[key] for key, said in published.addresses().items() if not said]
    asked = f"fill in {', '.join(missing)} under [tool.lidar-toolbox.addresses] in pyproject.toml"
    assert published.problems(path) == [asked] * bool(missing)
    assert (asked in told) == bool(missing)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        meta = archive.read("lidar_toolbox/metadata.txt").decode()
        tools = json.loads(archive.read("lidar_toolbox/tools.json"))
    assert all(name.startswith("lidar_toolbox/") for name in names)
    assert {"LICENSE", "icon.svg", "tools.json", "__init__.py"} <= {n.split("/")[1] for n in names}
    assert {n.rpartition(".")[2] for n in names} <= {"py", "txt", "svg", "json", "html"} | {
        "lidar_toolbox/LICENSE"
    }
    assert not any("environment.json" in name for name in names)
    assert f"\nversion={__version__}\n" in meta
    for key in (
        "name",
        "description",
        "about",
        "qgisMinimumVersion",
        "author",
        "icon",
        "tags",
        "changelog",
    ):
        assert f"\n{key}=" in meta
    assert "\nqgisMaximumVersion=4" in meta
    assert "supportsQt6" not in meta  # which the site calls deprecated
    assert "\nhasProcessingProvider=yes\n" in meta
    assert len(tools["tools"]) == len(catalog.ids())
    assert path.stat().st_size < 1_000_000
    again = path.read_bytes()
    main(["qgis", "package", str(path)])
    assert path.read_bytes() == again
    assert main(["qgis", "package", str(tmp_path / "no" / "a.zip")]) == 3


def test_addresses_come_from_the_settings_of_the_project(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = tmp_path / "pyproject.toml"
    settings.write_text(
        "[tool.lidar-toolbox.addresses]\nhomepage = 'https://a.org/100%'\n"
        "repository = 'https://a.org/r'\ntracker = 'a.org/t'\nmail = 'a@b.org'\n"
    )
    monkeypatch.setattr(published, "PROJECT", settings)
    path = tmp_path / "plugin.zip"
    assert main(["qgis", "package", str(path)]) == 0
    assert published.problems(path) == ["tracker must be an address of the web, got a.org/t"]
    with zipfile.ZipFile(path) as archive:
        meta = archive.read("lidar_toolbox/metadata.txt").decode()
    assert "\nemail=a@b.org\n" in meta
    assert "\nhomepage=https://a.org/100%%\n" in meta


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("lidar_toolbox/__pycache__/a.pyc", "", "must not be in it"),
        ("lidar_toolbox/../a.py", "", "is no plain path"),
        ("other/a.py", "", "must be in one folder"),
        ("lidar_toolbox/metadata.txt", "[general]\nname=a\n", "metadata.txt has no description"),
        ("lidar_toolbox/metadata.txt", "name=a\n", "metadata.txt cannot be read"),
        ("lidar_toolbox/metadata.txt", "[general]\nauthor=a/b\n", "author has a slash"),
        ("lidar_toolbox/metadata.txt", "[general]\nicon=no.svg\n", "there is no icon no.svg"),
        ("lidar_toolbox/LICENSE", None, "there is no LICENSE"),
    ],
)
def test_what_the_plugin_site_refuses_is_told(
    name: str, text: str | None, said: str, package: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.zip"
    with zipfile.ZipFile(package) as archive, zipfile.ZipFile(bad, "w") as other:
        for each in archive.namelist():
            if each != name:
                other.writestr(each, archive.read(each))
        if text is not None:
            other.writestr(name, text)
    assert said not in "\n".join(published.problems(package))
    assert said in "\n".join(published.problems(bad))


def test_the_licence_is_that_of_the_toolbox() -> None:
    licence = Path(__file__).resolve().parents[3] / "LICENSE"
    assert (SOURCE / "LICENSE").read_text() == licence.read_text()


def test_switching_on_changes_nothing_else() -> None:
    assert switched_on("") == "[PythonPlugins]\nlidar_toolbox=true\n"
    assert switched_on("[a]\nb=1").startswith("[a]\nb=1\n\n[PythonPlugins]\n")
    other = "[PythonPlugins]\nother=true\n\n[qgis]\nlidar_toolbox=false\n"
    assert switched_on(other) == other.replace("other=true", "lidar_toolbox=true\nother=true")
    off = "[x]\n[PythonPlugins]\nother=true\nlidar_toolbox=false\n[z]\nk=v\n"
    assert switched_on(off) == off.replace("=false", "=true")
    assert switched_on(switched_on(off)) == switched_on(off)


def test_install_and_doctor(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LIDAR_TOOLBOX_PYTHON", raising=False)
    program = tmp_path / "qgis_process"
    program.write_text("#!/bin/sh\necho 'QGIS 3.40.6-Bratislava'\n")
    program.chmod(0o755)
    monkeypatch.setenv(qgis_process.VARIABLE, str(program))
    profile = tmp_path / "Profil ü"
    argv = ["qgis", "doctor", "--profile", str(profile)]
    assert main(argv) == 3
    assert f"qgis install --profile {profile}" in capsys.readouterr().out
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    assert main(["qgis", "install", "--profile", str(profile)]) == 0
    assert "deactivate" not in capsys.readouterr().out
    monkeypatch.setenv("VIRTUAL_ENV", "lidar")  # in which QGIS would not find its own libraries
    assert main(["qgis", "install", "--profile", str(profile)]) == 0
    assert "say deactivate first" in capsys.readouterr().out
    assert main(argv) == 0
    told = capsys.readouterr().out
    assert "QGIS 3.40.6" in told
    assert f"{len(catalog.ids())} tools" in told
    assert sys.executable in told
    home = profile / "python/plugins/lidar_toolbox"
    (home / "stale.py").write_text("")
    assert main(["qgis", "install", "--profile", str(profile)]) == 0
    assert not (home / "stale.py").exists()
    assert [p.name for p in home.parent.iterdir()] == ["lidar_toolbox"]
    (profile / "QGIS/QGIS3.ini").write_text("[PythonPlugins]\nlidar_toolbox=false\n")
    (home / "tools.json").write_text("{}")
    (home / "environment.json").write_text('{"python": "/no/python"}')
    monkeypatch.setenv(qgis_process.VARIABLE, str(tmp_path / "none"))
    capsys.readouterr()
    assert main(argv) == 3
    seen = capsys.readouterr()
    for text in ("QGIS was not found", "tools.json", "not switched on", "no Python /no/python"):
        assert text in seen.out
    assert "things to mend: 4" in seen.err


@pytest.mark.slow
def test_doctor_asks_the_python_that_the_plugin_would_start(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LIDAR_TOOLBOX_PYTHON", raising=False)
    profile = tmp_path / "p"
    argv = ["qgis", "doctor", "--profile", str(profile)]
    assert main(["qgis", "install", "--profile", str(profile)]) == 0
    ini, own = profile / "QGIS/QGIS3.ini", profile / "lidar_toolbox_env/bin/python"
    chosen = "[lidar_toolbox]\npython={}\n[PythonPlugins]\nlidar_toolbox=true\n"
    ini.write_text(chosen.format(r"/no/pyth\xf6n"))
    main(argv)
    told = capsys.readouterr().out
    assert "there is no Python /no/pythön" in told
    assert "set another in Settings > Options" in told
    program = tmp_path / "bare"  # has the toolbox and not its libraries
    program.write_text(
        "#!/bin/sh\necho \"ModuleNotFoundError: No module named 'numpy'\" >&2; exit 1\n"
    )
    program.chmod(0o755)
    ini.write_text(chosen.format(program))
    main(argv)
    assert f"{program}: ModuleNotFoundError: No module named 'numpy'" in capsys.readouterr().out
    ini.write_text(chosen.format(tmp_path / "text").replace("python=/", "other=/"))
    (profile / "python/plugins/lidar_toolbox/environment.json").unlink()
    own.parent.mkdir(parents=True)
    own.write_text("no program")
    main(argv)
    assert f"there is no Python {own}" not in capsys.readouterr().out, "it is not whole"
    (profile / "lidar_toolbox_env/complete.txt").write_text("lidar-toolbox")
    main(argv)
    assert f"{own} does not start" in capsys.readouterr().out


def test_both_settings_of_a_profile_are_switched_and_nothing_else_is_lost(
    tmp_path: Path, capsys: Capture
) -> None:
    new = tmp_path / "QGIS4" / "profiles" / "default"
    assert main(["qgis", "install", "--profile", str(new)]) == 0
    assert [path.name for path in (new / "QGIS").iterdir()] == ["QGIS4.ini"]
    both = tmp_path / "both"
    (both / "QGIS").mkdir(parents=True)
    for name in ("QGIS3.ini", "QGIS4.ini"):
        (both / "QGIS" / name).write_bytes(b"[a]\nold=\xe9\n")
    assert main(["qgis", "install", "--profile", str(both)]) == 0
    for name in ("QGIS3.ini", "QGIS4.ini"):
        text = (both / "QGIS" / name).read_bytes()
        assert text == b"[a]\nold=\xe9\n\n[PythonPlugins]\nlidar_toolbox=true\n"
    assert main(["qgis", "uninstall", "--profile", str(both)]) == 0
    assert list((both / "python/plugins").iterdir()) == []
    assert (both / "QGIS/QGIS4.ini").read_bytes() == b"[a]\nold=\xe9\n\n[PythonPlugins]\n"
    assert main(["qgis", "uninstall", "--profile", str(both)]) == 3
    assert "the plugin is not in" in capsys.readouterr().err


def test_the_usual_profile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QGIS_CUSTOM_CONFIG_PATH", str(tmp_path))
    assert qgis_install.default_profile() == tmp_path / "profiles" / "default"
    for name in ("work", "last"):
        (tmp_path / "profiles" / name).mkdir(parents=True)
    ini = tmp_path / "profiles/profiles.ini"
    for text, name in (
        ("defaultProfile=work\n", "work"),
        ("defaultProfile=work\nlastProfile=last\n", "last"),
        ("defaultProfile=work\nlastProfile=last\nselectionPolicy=1\n", "work"),
        ("defaultProfile=work\nlastProfile=gone\nselectionPolicy=0\n", "work"),
        ("lastProfile=\n", "default"),
    ):
        ini.write_text("[core]\n" + text)
        assert qgis_install.default_profile() == tmp_path / "profiles" / name
