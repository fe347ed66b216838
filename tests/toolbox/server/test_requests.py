"""What a request may name, and what it may not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from toolbox import catalog
from toolbox.errors import ParameterError
from toolbox.server.requests import Places, outputs_of, values_of
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
        "points": 'a layer is given by reference: {"href": "name.laz"}',
        "clases": "unknown parameter",
    }
    assert problems("points.filter", {}, places) == {"points": "missing (Points to choose from)"}


def test_a_text_that_may_be_a_path_is_refused(places: Places) -> None:
    inputs = {"points": {"href": "a.laz"}, "crs": "EPSG:3035", "geoid": "/etc/passwd"}
    assert problems("points.reproject", inputs, places).keys() == {"geoid"}


def test_values_and_several_layers(places: Places) -> None:
    inputs = {"points": [{"href": "a.laz"}, {"href": "sub/b.laz"}], "duplicates": {"value": "keep"}}
    values = values_of(catalog.describe("points.merge"), inputs, places)
    assert [Path(path).name for path in values["points"]] == ["a.laz", "b.laz"]
    assert values["duplicates"] == "keep"


def test_outputs_are_all_layers_or_those_asked_for() -> None:
    described = catalog.describe("surface.contours")
    assert outputs_of(described, None) == {"contours": "contours.gpkg"}
    assert outputs_of(described, ["levels"]) == {}
    with pytest.raises(ParameterError, match="lines: unknown output"):
        outputs_of(described, ["lines"])


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "example.org"])
def test_an_address_that_others_reach_must_be_acknowledged(host: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="--behind-authentication"):
        check(host, tmp_path, exposed=False)
    check(host, tmp_path, exposed=True)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_loopback_needs_no_word(host: str, tmp_path: Path) -> None:
    check(host, tmp_path, exposed=False)
    with pytest.raises(ParameterError, match="data: must be a folder"):
        check(host, tmp_path / "none", exposed=False)
