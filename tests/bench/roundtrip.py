"""Every readable cloud written in every format and read again: what comes back, what is lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.measuring import DATA, folder, say

READ = (".las", ".laz", ".txt.gz", ".csv.gz", ".ply", ".ply.gz", ".pcd", ".e57", ".ptx", ".pts")
WRITTEN = (".las", ".laz", ".copc.laz", ".ply", ".csv.gz", ".parquet")
MOST = 1_000_000  # points; larger files go through LAS and LAZ alone
STEP = 5.1e-5  # half of the coarsest step of LAS for coordinates that came without one


def roundtrip() -> None:
    """Each file through each format: how many come back whole, and what others lose."""
    from toolbox.data import PointCloud
    from toolbox.errors import DataError

    results: Counter[tuple[str, str]] = Counter()
    paths = sorted(p for p in DATA.rglob("*") if p.name.lower().endswith(READ))
    with folder() as out:
        for path in paths:
            try:
                cloud = PointCloud.open(path)
            except DataError as error:
                say(f"roundtrip  {path.parent.name}/{path.name}: {str(error)[:120]}")
                results["read", "refused"] += 1
                continue
            for suffix in WRITTEN if len(cloud) <= MOST else (".las", ".laz"):
                copy = out / f"a{suffix}"
                try:
                    cloud.save(copy, overwrite=True)
                    found = list(_differences(cloud, path, copy))
                except DataError as error:
                    found = [f"refused: {str(error).partition(': ')[2][:110]}"]
                for text in found or ["whole"]:
                    results[suffix, text] += 1
                copy.unlink(missing_ok=True)
    say(f"roundtrip  {len(paths)} files")
    for (suffix, text), count in sorted(results.items(), key=lambda item: (item[0][0], -item[1])):
        say(f"roundtrip  {suffix:9} {count:3}  {text}")


def _differences(cloud: Any, path: Path, copy: Path) -> Iterator[str]:
    from toolbox.data import PointCloud
    from toolbox.data.crs import same_crs

    if copy.suffix == ".parquet":
        yield from _in_table(cloud, copy)
        return
    back = PointCloud.open(copy)
    order, again = _order(cloud), _order(back)
    if len(cloud) != len(back):
        yield "the number of points differs"
        return
    away = float(np.abs(cloud.xyz[order] - back.xyz[again]).max(initial=0))
    if away > STEP:
        yield "coordinates differ by more than 0.05 mm"
    elif away:
        yield "coordinates rounded to the steps of LAS, or to decimals"
    if lost := [name for name in cloud.names if name not in back]:
        yield f"attributes lost: {', '.join(sorted(lost))[:90]}"
    kept = [name for name in cloud.names if name in back]
    if not away and any(not _equal(cloud[n][order], back[n][again]) for n in kept):
        yield "values of attributes differ"
    if not same_crs(cloud.crs, back.crs):
        yield "the CRS is lost" if back.crs is None else "the CRS differs"
    if {path.suffix.lower(), copy.suffix} <= {".las", ".laz"} and ".copc" not in copy.name:
        yield from _in_records(path, copy)


def _order(cloud: Any) -> Any:
    """Points by place, then by all that tells them apart, as COPC sorts them otherwise."""
    keys = [np.ravel(cloud[n]) for n in ("gps_time", "intensity", "return_number") if n in cloud]
    return np.lexsort([*keys, *np.round(cloud.xyz, 4).T])


def _in_table(cloud: Any, copy: Path) -> Iterator[str]:
    import geopandas
    import shapely

    frame = geopandas.read_parquet(copy)
    xyz = shapely.get_coordinates(frame.geometry.to_numpy(), include_z=True)
    if not np.array_equal(xyz, cloud.xyz):
        yield "coordinates differ"
    single = [name for name in cloud.names if cloud[name].ndim == 1]
    if any(not _equal(cloud[name], frame[name].to_numpy()) for name in single):
        yield "values of attributes differ"
    if (frame.crs is None) != (cloud.crs is None):
        yield "the CRS is lost"


def _in_records(path: Path, copy: Path) -> Iterator[str]:
    """Raw point records and VLRs, by another reader."""
    import laspy

    if path.parent.name == "robustness":
        return
    one, two = laspy.read(path), laspy.read(copy)
    if one.points.array.tobytes() != two.points.array.tobytes():
        yield "raw point records differ"
    records = [
        {(v.user_id, v.record_id, v.record_data_bytes()) for v in las.vlrs if v.user_id != "copc"}
        for las in (one, two)
    ]
    if records[0] != records[1]:
        yield "VLRs differ"


def _equal(one: Any, two: Any) -> bool:
    return bool(np.array_equal(one, two, equal_nan=one.dtype.kind == "f"))
