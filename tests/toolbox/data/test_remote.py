"""Files on the web: ranges, errors by name, versions, what is kept, and nothing secret told."""

from __future__ import annotations

import base64
import json
import logging
import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from scenes.layers import UTM, cloud, raster
from scenes.server import Server, serving

import toolbox
from toolbox.data import PointCloud, Raster, Survey, Table, Vector
from toolbox.data.las import octree
from toolbox.data.record import read_record
from toolbox.data.remote import store, stream
from toolbox.data.remote.address import Address, as_path
from toolbox.errors import DataError, ToolboxError

pytest.importorskip("obstore")

SECRET = "sig=very-secret"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Server]:
    """A server, whose files are kept in a folder of the test, and little patience."""
    monkeypatch.setenv(stream.FOLDER_VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr(store, "TIMEOUT", 0.6)
    monkeypatch.setattr(store, "RETRIES", 1)
    monkeypatch.setattr(store, "FRESH", 0.0)
    for name in [name for name in os.environ if name.startswith(("AWS_", "HTTP_PROXY"))]:
        monkeypatch.delenv(name)
    with serving() as found:
        yield found


def points(count: int = 40_000, seed: int = 1) -> PointCloud:
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((500_000, 4_600_000, 0), (500_400, 4_600_400, 9), (count, 3))
    return cloud(xyz, 2, gps_time=np.arange(float(count)))


def put(server: Server, layer: Any, name: str, folder: Path) -> str:
    """Serve a layer under a name; gives its address."""
    path = folder / Path(name).name
    layer.save(path)
    server.files[f"/{name}"] = path.read_bytes()
    path.unlink()
    return f"{server.url}/{name}"


def test_a_part_of_a_copc_moves_a_part_of_the_file(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(octree, "FEWEST", 50)
    monkeypatch.setattr(store, "FRESH", 60.0)
    whole = points(400_000)
    address = put(server, whole, "a.copc.laz", tmp_path)
    box = (500_100, 4_600_100, 500_110, 4_600_110)
    near = PointCloud.open(address, bounds=box)
    assert sorted(near["gps_time"]) == sorted(whole.within(box)["gps_time"])
    assert server.sent < 0.5 * len(server.files["/a.copc.laz"])
    before, store._known = server.sent, {}
    again = PointCloud.open(address, bounds=box)
    np.testing.assert_array_equal(again.xyz, near.xyz)
    assert server.sent - before == store.FIRST  # whether it is still the same


def test_all_kinds_of_layers_are_read(server: Server, tmp_path: Path) -> None:
    some = points(2000)
    for name in ("a.las", "a.laz", "a.copc.laz", "ä b.laz", "a.csv.gz", "a.ply"):
        found = PointCloud.open(put(server, some, name, tmp_path), assume_crs=UTM)
        assert len(found) == 2000, name
        assert found.name == name
    heights = raster(np.arange(600.0).reshape(20, 30))
    heights.save(tmp_path / "cog.tif", cog=True)
    server.files["/dtm.tif"] = (tmp_path / "cog.tif").read_bytes()
    np.testing.assert_array_equal(Raster.open(f"{server.url}/dtm.tif").values, heights.values)
    lake = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 9, 9)], crs=UTM))
    assert len(Vector.open(put(server, lake, "lake.gpkg", tmp_path))) == 1
    table = Table.from_rows([{"a": 1}, {"a": 2}])
    assert len(Table.open(put(server, table, "t.csv", tmp_path))) == 2


def test_a_survey_of_addresses_in_an_index(server: Server, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    whole = points(3000)
    east = whole.xyz[:, 0] > 500_200
    for name, part in (("a.copc.laz", whole.select(~east)), ("b.laz", whole.select(east))):
        part.save(tmp_path / "in" / name)
        server.files[f"/data/{name}"] = (tmp_path / "in" / name).read_bytes()
    toolbox.run("points.index", {"points": tmp_path / "in", "index": tmp_path / "in/all.vpc"})
    index = (tmp_path / "in/all.vpc").read_bytes()
    server.files["/data/all.vpc"] = index
    remote = f"{server.url}/data/all.vpc?{SECRET}"
    local = tmp_path / "remote.vpc"
    local.write_bytes(index.replace(b'"./', f'"{server.url}/data/'.encode()))
    for path in (remote, local):
        assert Survey.open(path).count == 3000
        assert sorted(PointCloud.open(path)["gps_time"]) == list(range(3000))
    assert all(SECRET in path for path, *_ in server.asked if "all.vpc" in path)
    assert any(SECRET in path for path, *_ in server.asked if "b.laz" in path)


def test_tiles_of_addresses_are_those_of_files(server: Server, tmp_path: Path) -> None:
    """A file, its address, and an index of this computer whose items are on the web."""
    whole = points(3000)
    whole.save(tmp_path / "a.laz")
    server.files["/a.laz"] = (tmp_path / "a.laz").read_bytes()
    toolbox.run("points.index", {"points": tmp_path / "a.laz", "index": tmp_path / "a.vpc"})
    index = (tmp_path / "a.vpc").read_text().replace("./a.laz", f"{server.url}/a.laz")
    (tmp_path / "web.vpc").write_text(index)
    found = []
    for number, path in enumerate(
        (tmp_path / "a.laz", f"{server.url}/a.laz", tmp_path / "web.vpc")
    ):
        out = tmp_path / f"{number}.laz"
        tiling = toolbox.tiles.tiling.Tiling.parse({"tile": "200", "workers": "1"})
        values = {"points": str(path), "cell": 20.0, "thinned": out}
        toolbox.run("points.thin", values, tiling=tiling)
        found.append(PointCloud.open(out))
    assert server.sent
    for other in found[1:]:
        np.testing.assert_array_equal(found[0].xyz, other.xyz)


FAULTS = {
    "stall": r"the server does not answer within 0\.6 s",
    "cut": "breaks off",
    "cut later": "breaks off",
    "lie": "changed while the run was reading",
    "whole": "does not answer to ranges",
    403: "the server refuses access; are the credentials right",
    401: "the server refuses access",
    404: "there is no ",
    500: "500",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_goes_wrong_is_told_by_address(
    fault: Any, server: Server, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    address = put(server, points(), "a.laz", tmp_path)
    server.faults["/a.laz"] = fault
    values = {"points": f"{address}?{SECRET}", "thinned": tmp_path / "b.laz"}
    with caplog.at_level(logging.DEBUG), pytest.raises(ToolboxError, match=FAULTS[fault]) as error:
        toolbox.run("points.thin", values)
    assert address in str(error.value)
    assert SECRET not in str(error.value) + caplog.text
    assert not (tmp_path / "b.laz").exists()


def test_servers_that_are_not_there(server: Server) -> None:
    for address, text in (
        ("http://127.0.0.1:9/a.laz", "cannot be reached"),
        ("http://no-such-host.invalid/a.laz", "no such server|cannot be reached"),
        ("ftp://example.org/a.laz", r"read from https://, http://, s3://"),
    ):
        with pytest.raises(DataError, match=text) as error:
            PointCloud.open(address)
        assert address in str(error.value)


def test_all_of_it_can_be_switched_off(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.OFFLINE_VARIABLE, "1")
    with pytest.raises(DataError, match="nothing is read from the web"):
        PointCloud.open(f"{server.url}/a.laz")
    assert not server.asked


def test_a_busy_server_is_asked_again(server: Server, tmp_path: Path) -> None:
    address = put(server, points(), "a.laz", tmp_path)
    server.faults["/a.laz"] = "busy"
    assert len(PointCloud.open(address)) == 40_000


def test_a_file_that_changes_meanwhile_is_noticed(server: Server, tmp_path: Path) -> None:
    address = put(server, points(), "a.laz", tmp_path)
    with Address(address).open("rb") as opened:
        opened.read(100)
        server.tags["/a.laz"] = '"two"'
        opened.seek(200_000)
        with pytest.raises(DataError, match="changed while the run was reading"):
            opened.read(100)


def test_a_new_version_is_read_anew(server: Server) -> None:
    address = Address(f"{server.url}/a.laz")
    for number in (1, 2):
        server.files["/a.laz"] = bytes([number]) * 50_000
        server.tags["/a.laz"] = f'"{number}"'
        assert address.read_bytes() == server.files["/a.laz"]


def test_without_versions_nothing_is_kept(server: Server, tmp_path: Path) -> None:
    address = put(server, points(2000), "a.laz", tmp_path)
    server.tags["/a.laz"] = ""
    PointCloud.open(address)
    put(server, points(2000, seed=2), "a.laz", tmp_path)
    assert PointCloud.open(address)["x"][0] == pytest.approx(points(2000, seed=2)["x"][0], abs=0.01)
    assert not any((tmp_path / "kept").glob("*"))


def test_what_is_kept_has_a_limit(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(stream.LIMIT_VARIABLE, "300000")
    for number in range(4):
        PointCloud.open(put(server, points(20_000, seed=number), f"{number}.laz", tmp_path))
        assert sum(p.stat().st_size for p in (tmp_path / "kept").rglob("*") if p.is_file()) <= 3e5
    assert (tmp_path / "kept").stat().st_mode & 0o077 == 0
    monkeypatch.setenv(stream.LIMIT_VARIABLE, "much")
    with pytest.raises(DataError, match="must be a number of bytes"):
        stream.limit()


def test_a_record_names_the_address_without_its_signature(server: Server, tmp_path: Path) -> None:
    address = put(server, points(2000), "a.laz", tmp_path)
    values = {"points": f"{address}?{SECRET}", "thinned": tmp_path / "b.laz", "cell": 50.0}
    toolbox.run("points.thin", values)
    record = read_record(tmp_path / "b.laz")
    assert address in record
    assert "very-secret" not in record
    assert b"very-secret" not in (tmp_path / "b.laz").read_bytes()


def test_buckets_with_keys_of_the_environment(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(server, points(2000), "bucket/deep/a.laz", tmp_path)
    monkeypatch.setenv("AWS_ENDPOINT_URL", server.url)
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    monkeypatch.setenv("AWS_REGION", "eu-north-1")
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "config"))
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "credentials"))
    store._opened.cache_clear()
    assert len(PointCloud.open("s3://bucket/deep/a.laz")) == 2000
    assert all("authorization" not in headers for *_, headers in lowered(server))
    (tmp_path / "credentials").write_text(
        "[survey]\naws_access_key_id = KEYNAME\naws_secret_access_key = very-secret\n"
    )
    monkeypatch.setenv("AWS_PROFILE", "survey")
    store._opened.cache_clear()
    server.asked.clear()
    assert len(PointCloud.open("s3://bucket/deep/a.laz")) == 2000
    assert all("KEYNAME" in headers["authorization"] for *_, headers in lowered(server))
    server.faults["/bucket/deep/a.laz"] = 403
    with pytest.raises(DataError, match=r"s3://bucket/deep/a\.laz cannot be read") as error:
        PointCloud.open("s3://bucket/deep/a.laz")
    assert "very-secret" not in str(error.value)
    store._opened.cache_clear()


def test_google_with_and_without_a_token(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.files["/bucket/deep/a.laz"] = laz(tmp_path)
    for name in [name for name in os.environ if name.startswith("GOOGLE_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("GOOGLE_BASE_URL", server.url)
    monkeypatch.setenv("GOOGLE_ALLOW_HTTP", "true")
    store._opened.cache_clear()
    assert len(PointCloud.open("gs://bucket/deep/a.laz")) == 2000
    assert all("authorization" not in headers for *_, headers in lowered(server))
    monkeypatch.setenv("GOOGLE_SERVICE_ACCOUNT_KEY", json.dumps(SERVICE))
    store._opened.cache_clear()
    store._known.clear()
    with pytest.raises(DataError, match="keys, account or endpoint in the env") as error:
        PointCloud.open("gs://bucket/deep/a.laz")
    assert "very-secret" not in str(error.value)
    monkeypatch.delenv("GOOGLE_SERVICE_ACCOUNT_KEY")
    monkeypatch.setenv("GOOGLE_BEARER_TOKEN", "very-secret")
    store._opened.cache_clear()
    server.asked.clear()
    assert len(PointCloud.open("gs://bucket/deep/a.laz")) == 2000
    assert all(headers["authorization"] == "Bearer very-secret" for *_, headers in lowered(server))
    store._opened.cache_clear()


SERVICE = {
    "type": "service_account",
    "private_key": "very-secret",
    "private_key_id": "1",
    "client_email": "a@example.org",
}


def test_azure_with_and_without_keys(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.files["/box/deep/a.laz"] = laz(tmp_path)
    for name in [name for name in os.environ if name.startswith("AZURE_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("AZURE_STORAGE_ENDPOINT", server.url)
    monkeypatch.setenv("AZURE_ALLOW_HTTP", "true")
    store._opened.cache_clear()
    with pytest.raises(DataError, match="name the account in AZURE_STORAGE_ACCOUNT_NAME"):
        PointCloud.open("az://box/deep/a.laz")
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_NAME", "survey")
    assert len(PointCloud.open("az://box/deep/a.laz")) == 2000
    assert all("authorization" not in headers for *_, headers in lowered(server))
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", base64.b64encode(b"very-secret").decode())
    store._opened.cache_clear()
    store._known.clear()
    server.asked.clear()
    assert len(PointCloud.open("az://box/deep/a.laz")) == 2000
    signed = [headers["authorization"] for *_, headers in lowered(server)]
    assert all(text.startswith("SharedKey survey:") for text in signed)
    monkeypatch.delenv("AZURE_STORAGE_ACCOUNT_KEY")
    monkeypatch.setenv("AZURE_STORAGE_SAS_TOKEN", "sv=1&sig=very-secret")
    store._opened.cache_clear()
    store._known.clear()
    server.faults["/box/deep/a.laz"] = 403
    with pytest.raises(DataError, match=r"az://box/deep/a\.laz cannot be read.*refuses") as error:
        PointCloud.open("az://box/deep/a.laz")
    assert "sig=very-secret" in server.asked[-1][0]
    assert "very-secret" not in str(error.value)
    store._opened.cache_clear()


def laz(folder: Path) -> bytes:
    """The bytes of a file of 2000 points."""
    points(2000).save(folder / "made.laz")
    return (folder / "made.laz").read_bytes()


def lowered(server: Server) -> list[tuple[str, dict[str, str]]]:
    return [(path, {k.lower(): v for k, v in how.items()}) for path, _, how in server.asked]


def test_a_shapefile_and_writing_are_refused(server: Server) -> None:
    with pytest.raises(DataError, match="one of several files"):
        Vector.open(f"{server.url}/a.shp")
    with pytest.raises(PermissionError, match="nothing is written"):
        Address(f"{server.url}/a.laz").open("wb")


def test_an_index_on_the_web_names_no_files_of_this_computer(server: Server) -> None:
    item = {"assets": {"data": {"href": "file:///etc/passwd.laz", "roles": ["data"]}}}
    server.files["/a.vpc"] = json.dumps({"features": [item]}).encode()
    with pytest.raises(DataError, match="names files of this computer"):
        Survey.open(f"{server.url}/a.vpc")


def test_addresses_go_through_processes() -> None:
    address = Address(f"https://me:pw@example.org/d/a.laz?{SECRET}")
    again = pickle.loads(pickle.dumps(address))
    assert again == address
    assert again.url == address.url
    assert str(again) == "https://example.org/d/a.laz"
    assert again.joined("./b.laz").url == f"https://me:pw@example.org/d/b.laz?{SECRET}"
    assert as_path(again) is again
    assert "pw" not in repr(again)
    assert Address("s3://bucket/a/b.laz").joined("../c.laz").url == "s3://bucket/c.laz"
