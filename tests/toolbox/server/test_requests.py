"""What a request may name, and what it may not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from toolbox import catalog
from toolbox.errors import DataError, ParameterError
from toolbox.server.jobs import Jobs, Limits
from toolbox.server.requests import Places, outputs_of, problem_of, values_of
from toolbox.server.serve import check

JOB = "6db873d5-02c3-4ae4-afa4-1c04ed36636d"


@pytest.fixture
def places(tmp_path: Path) -> Places:
    for name in (
        f"jobs/{JOB}/kept.laz",
        "data/a.laz",
        "data/sub/b.laz",
        "data/c.vpc",
        "secret.laz",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "data" / "link.laz").symlink_to(tmp_path / "secret.laz")
    return Places(tmp_path / "data", tmp_path / "jobs")


@pytest.mark.parametrize(
    ("href", "path"),
    [
        ("a.laz", "data/a.laz"),
        ("sub/b.laz", "data/sub/b.laz"),
        (f"http://127.0.0.1:5000/files/{JOB}/kept.laz", f"jobs/{JOB}/kept.laz"),
    ],
)
def test_data_and_results_may_be_named(places: Places, href: str, path: str) -> None:
    assert places.path_of(href) == places.data.parent / path


@pytest.mark.parametrize(
    "href",
    [
        "../secret.laz",
        "sub/../../secret.laz",
        "%2e%2e/secret.laz",
        "link.laz",
        "/etc/passwd",
        "file:///etc/passwd",
        "https://example.org/a.laz",
        "/vsicurl/https://example.org/a.tif",
        f"/files/{JOB}/../kept.laz",
        f"/files/{JOB}/..",
        "missing.laz",
        "",
        "c.vpc",
    ],
)
def test_nothing_else_may_be_named(places: Places, href: str) -> None:
    with pytest.raises(ValueError, match=r"is no file of the data|names other files"):
        places.path_of(href)


def problems(tool: str, inputs: dict[str, Any], places: Places) -> dict[str, str]:
    with pytest.raises(ParameterError) as caught:
        values_of(catalog.describe(tool), inputs, places)
    return dict(caught.value.problems)


def test_all_problems_of_a_request_are_told_at_once(places: Places) -> None:
    found = problems("points.filter", {"points": "a.laz", "clases": "2"}, places)
    assert found == {
        "points": 'a layer or file is given by reference: {"href": "name.laz"}',
        "clases": "unknown parameter",
    }
    assert problems("points.filter", {}, places) == {"points": "missing (Points to choose from)"}


def test_a_text_that_may_be_a_path_is_refused(places: Places) -> None:
    inputs = {"points": {"href": "a.laz"}, "pattern": "../{x}_{y}.laz"}
    assert problems("points.retile", inputs, places).keys() == {"pattern"}


@pytest.mark.parametrize("geoid", ["/etc/passwd", {"href": "/etc/passwd"}, {"value": "a.laz"}])
def test_a_file_that_is_no_layer_comes_by_reference_too(places: Places, geoid: Any) -> None:
    inputs = {"points": {"href": "a.laz"}, "crs": "EPSG:3035", "geoid": geoid}
    assert problems("points.reproject", inputs, places).keys() == {"geoid"}
    inputs["geoid"] = {"href": "sub/b.laz"}
    values = values_of(catalog.describe("points.reproject"), inputs, places)
    assert Path(values["geoid"]).name == "b.laz"


def test_no_other_kind_of_parameter_names_a_file() -> None:
    """A kind that is new here has to be looked at before a request may fill it."""
    kinds = {
        meta["value"]
        for id in catalog.own_ids()
        for field in catalog.describe(id)["inputs"].values()
        for meta in field["metadata"]
        if meta["role"] == "type"
    }
    layers = {"PointCloud", "Vector", "Raster", "Table", "Survey"}
    numbers = {"number", "integer", "boolean", "extent", "position", "range", "direction"}
    words = {"text", "file", "choice", "class list", "attribute", "CRS", "expression"}
    assert kinds <= layers | numbers | words


def test_values_and_several_layers(places: Places) -> None:
    inputs = {"points": [{"href": "a.laz"}, {"href": "sub/b.laz"}], "duplicates": {"value": "keep"}}
    values = values_of(catalog.describe("points.merge"), inputs, places)
    assert [Path(path).name for path in values["points"]] == ["a.laz", "b.laz"]
    assert values["duplicates"] == "keep"


def test_outputs_are_all_layers_or_those_asked_for() -> None:
    described = catalog.describe("surface.contours")
    layers = {"contours": "contours.gpkg", "labels": "labels.gpkg"}
    assert outputs_of(described, None) == layers
    assert outputs_of(described, ["labels"]) == {"labels": "labels.gpkg"}
    assert outputs_of(described, ["levels"]) == {}
    with pytest.raises(ParameterError, match="lines: unknown output"):
        outputs_of(described, ["lines"])


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "example.org"])
def test_an_address_that_others_reach_must_be_acknowledged(host: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="--behind-authentication"):
        check(host, 5000, tmp_path, Limits(), exposed=False)
    check(host, 5000, tmp_path, Limits(), exposed=True)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_loopback_needs_no_word(host: str, tmp_path: Path) -> None:
    check(host, 5000, tmp_path, Limits(), exposed=False)
    with pytest.raises(ParameterError, match="data: must be a folder"):
        check(host, 5000, tmp_path / "none", Limits(), exposed=False)


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (b"{", "not JSON"),
        (b"\xff", "not JSON"),
        (b"[" * 10**5, "not JSON"),
        (b"null", "the body must be an object"),
        (b"[]", "the body must be an object"),
        (b'{"inputs": []}', "inputs must be an object"),
        (b'{"inputs": {}, "outputs": "all"}', "outputs must be an object"),
        (b'{"inputs": {}, "subscriber": "me"}', "subscriber must be an object"),
    ],
)
def test_a_body_that_asks_for_no_job_is_told_so(body: bytes, problem: str) -> None:
    assert problem in str(problem_of(body))


def test_a_body_may_name_inputs_and_outputs() -> None:
    assert problem_of(b'{"inputs": {"cell": 1}, "outputs": {"dtm": {}}}') is None


def test_a_server_that_could_run_no_job_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError) as caught:
        check("::1", 0, tmp_path, Limits(0, -1, float("nan"), 0), exposed=False)
    assert caught.value.problems.keys() == {"port", "jobs", "waiting", "seconds", "megabytes"}
    assert caught.value.problems["jobs"] == "must be > 0, got 0"


def test_a_folder_of_jobs_has_one_server(tmp_path: Path) -> None:
    first = Jobs(tmp_path, Limits())
    with pytest.raises(DataError, match="is used by another server"):
        Jobs(tmp_path, Limits())
    first.lock.close()
    Jobs(tmp_path, Limits())


@pytest.mark.parametrize(
    "url",
    [
        "example.org",
        "ftp://example.org",
        "https://",
        "https://example.org/?a=b",
        "https://me:secret@example.org",
        "https://example.org:99999",
        "https://example.org/a b",
    ],
)
def test_public_addresses_that_make_no_links_are_refused(tmp_path: Path, url: str) -> None:
    with pytest.raises(ParameterError, match=r"url: must be like https://example.org/lidar"):
        check("127.0.0.1", 5000, tmp_path, Limits(), exposed=False, url=url)
    check("127.0.0.1", 5000, tmp_path, Limits(), exposed=False, url="https://example.org/lidar/")


def test_results_are_known_by_their_public_address(tmp_path: Path) -> None:
    """Also below a path that the proxy takes off; other paths before it are none of ours."""
    id = "0" * 36
    (tmp_path / "jobs" / id).mkdir(parents=True)
    (tmp_path / "data").mkdir()
    (tmp_path / "jobs" / id / "kept.laz").write_bytes(b"")
    places = Places(tmp_path / "data", tmp_path / "jobs", "https://example.org/lidar")
    found = places.path_of(f"https://example.org/lidar/files/{id}/kept.laz")
    assert found == (tmp_path / "jobs" / id / "kept.laz").resolve()
    with pytest.raises(ValueError, match="is no file of the data of this server, and no result"):
        places.path_of(f"https://example.org/other/files/{id}/kept.laz")


def test_rectangles_and_positions_say_what_they_are_in() -> None:
    for tool, name in (("points.clip", "extent"), ("shoreline.extract", "seed_point")):
        said = {
            one["role"]: one["value"] for one in catalog.describe(tool)["inputs"][name]["metadata"]
        }
        assert said["coordinates"].endswith("in the CRS and unit of the data, easting first")
