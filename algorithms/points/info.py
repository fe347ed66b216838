"""Properties of a point cloud, and warnings about its data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from algorithms.points import _info_survey
from algorithms.shared.plausible import height_problem, is_on_map, two_surveys
from algorithms.shared.returns import ReturnNumbers, has_numbers
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Survey, Table
from toolbox.data.area_of_use import misplaced
from toolbox.data.asprs import NAMES
from toolbox.data.crs import (
    describe_crs,
    height_system,
    length_problem,
    vertical_unit,
)
from toolbox.data.precision import rounded_to_single
from toolbox.declare import outputs, sink, source, tool

PERCENTILES = (0, 1, 5, 25, 50, 75, 95, 99, 100)
POINTS_PER_CELL = 10  # of the grid that tells covered ground from gaps
RANGES = 3  # of 98 % of the heights: a hill or a tower in a plain is within as many
LEAST_MARGIN = 10.0  # metres, for a plain whose range is nothing: houses and trees are lower
WAVE = "wavepacket_index"  # attribute of points: the number of a descriptor, 0 without a waveform

Row = dict[str, Any]


@tool(
    "points.info",
    title="Information about points",
    tags=(
        "info",
        "statistics",
        "summary",
        "density",
        "extent",
        "header",
        "metadata",
        "report",
        "lasinfo",
    ),
)
class PointsInfo:
    """Report counts, bounds, CRS, density, classes, returns and warnings of a point cloud.

    The density counts only cells that hold points, so that gaps and an oblique outline do not
    dilute it.

    Of several files (a folder, a list, a pattern or a VPC) only the headers are read, with their
    bounding boxes: the area that the files cover and share, the holes between them, the mean
    density, their formats, and one row per file. Nothing is said there about single points.
    """

    points: PointCloud | Survey = source("Points to describe")

    @outputs
    class Outputs:
        table: Table = sink("One row per property: property, value, unit")
        count: int = sink("Number of points", unit="1")
        density: float | None = sink(
            "Points per area of cells that hold some; of several files per area of their boxes",
            unit="1/m2",
        )
        files: Table | None = sink(
            "One row per file, where there are several; density is points per area of the box"
        )

    def halo(self) -> float:
        """Zero, as each point is counted by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsInfo.Outputs:
        """Collect the rows."""
        if isinstance(self.points, Survey):
            return self._of_survey(self.points)
        cloud = self.points
        area = covered_area(cloud)
        density = len(cloud) / area if area else None
        rows = [
            *_general(cloud),
            *_coverage(cloud, area),
            *_counts(cloud),
            *_intensity(cloud),
            *_waveforms(cloud),
            *({"property": "warning", "value": text} for text in warnings(cloud)),
        ]
        ctx.progress(1.0)
        metric = length_problem(cloud.crs) is None
        return self.Outputs(
            table=_table(rows),
            count=int(np.count_nonzero(cloud.core)),
            density=density if metric else None,
            files=None,
        )

    def _of_survey(self, survey: Survey) -> PointsInfo.Outputs:
        cover = _info_survey.Cover(survey)
        texts = _info_survey.warnings(survey)
        rows = [
            *_info_survey.figures(survey, cover),
            *({"property": "warning", "value": text} for text in texts),
        ]
        metric = length_problem(survey.crs) is None and cover.area > 0
        return self.Outputs(
            table=_table(rows),
            count=survey.count,
            density=survey.count / cover.area if metric else None,
            files=Table.from_rows(_info_survey.file_rows(survey)),
        )


def _table(rows: Iterable[Row]) -> Table:
    return Table.from_rows([{"property": "", "value": None, "unit": ""} | row for row in rows])


def covered_area(cloud: PointCloud) -> float:
    """Area of the cells that hold points, in square units of the coordinates; 0 for an empty cloud.

    The cell is chosen so that it would hold ten points if they filled their bounding box evenly.
    """
    if len(cloud) == 0:
        return 0.0
    x, y = cloud["x"], cloud["y"]
    box = (x.max() - x.min()) * (y.max() - y.min())
    if box <= 0:
        return 0.0
    cell = np.sqrt(POINTS_PER_CELL * box / len(cloud))
    col = ((x - x.min()) // cell).astype(np.int64)
    row = ((y - y.min()) // cell).astype(np.int64)
    return float(len(np.unique(row * (col.max() + 1) + col)) * cell**2)


def _general(cloud: PointCloud) -> Iterator[Row]:
    yield {"property": "file", "value": cloud.name}
    yield {"property": "points", "value": len(cloud)}
    yield {"property": "crs", "value": describe_crs(cloud.crs) if cloud.crs else None}
    if cloud.crs:
        yield {"property": "heights", "value": height_system(cloud.crs)}
    for name in cloud.names:
        yield {"property": f"attribute {name}", "value": cloud[name].dtype.name}
    if len(cloud):
        unit = vertical_unit(cloud.crs)
        names = ("xmin", "ymin", "zmin", "xmax", "ymax", "zmax")
        for name, value in zip(names, cloud.bounds, strict=True):
            yield {"property": name, "value": value, "unit": unit if name[0] == "z" else ""}
        yield from _info_survey.place_on_earth(cloud.crs, cloud.bounds)


def _waveforms(cloud: PointCloud) -> Iterator[Row]:
    """Where waveforms are, how many points have one, and how each kind is sampled."""
    place, size, kinds = cloud.waveforms
    if not (place or kinds):
        return
    yield {"property": "waveforms", "value": place or "not there, though they are described"}
    used = np.zeros(0, np.uint8)
    if WAVE in cloud:
        used = cloud[WAVE]
        count = int(np.count_nonzero(used))
        yield {"property": "points with waveform", "value": count, "unit": "points"}
        if size:
            yield {"property": "waveform packets", "value": size, "unit": "bytes"}
            yield from _cut_off(cloud, size)
    for kind in kinds:
        says = f"{kind.samples} samples of {kind.bits} bits, {kind.spacing} ps apart"
        says += ", compressed" if kind.compression else ""
        yield {"property": f"waveforms of descriptor {kind.number}", "value": says}
    if unknown := sorted(set(np.unique(used).tolist()) - {0, *(kind.number for kind in kinds)}):
        numbers = ", ".join(map(str, unknown))
        text = f"points have waveforms of descriptors that are not there: {numbers}"
        yield {"property": "warning", "value": text}


def _cut_off(cloud: PointCloud, size: int) -> Iterator[Row]:
    """A warning if packets of points end beyond the bytes that are there."""
    ends = cloud["wavepacket_offset"] + cloud["wavepacket_size"].astype(np.uint64)
    if count := int(np.count_nonzero((cloud[WAVE] > 0) & (ends > size))):
        text = f"waveforms of {count} points are beyond the end of the packets: they are cut off"
        yield {"property": "warning", "value": text}


def _coverage(cloud: PointCloud, area: float) -> Iterator[Row]:
    if not area:
        return
    metric = length_problem(cloud.crs) is None
    square = cloud.metre**2 if metric else 1.0
    unit = "m2" if metric else "square unit"
    yield {"property": "covered area", "value": area / square, "unit": unit}
    yield {"property": "density", "value": len(cloud) * square / area, "unit": f"1/{unit}"}
    if "return_number" in cloud and (first := int((cloud["return_number"] == 1).sum())):
        yield {"property": "pulse density", "value": first * square / area, "unit": f"1/{unit}"}


def _counts(cloud: PointCloud) -> Iterator[Row]:
    for name in ("classification", "return_number", "number_of_returns"):
        if name not in cloud:
            continue
        for value, count in zip(*np.unique(cloud[name], return_counts=True), strict=True):
            known = NAMES.get(value, "") if name == "classification" else ""
            label = f"{name} {value:g} {known}".strip()
            yield {"property": label, "value": int(count), "unit": "points"}
    for name in ("synthetic", "key_point", "withheld", "overlap"):
        if name in cloud and (count := int(np.count_nonzero(cloud[name]))):
            yield {"property": f"flag {name}", "value": count, "unit": "points"}


def _intensity(cloud: PointCloud) -> Iterator[Row]:
    if "intensity" not in cloud or len(cloud) == 0:
        return
    values = np.percentile(cloud["intensity"], PERCENTILES)
    for percent, value in zip(PERCENTILES, values, strict=True):
        yield {"property": f"intensity percentile {percent}", "value": float(value)}


def warnings(cloud: PointCloud) -> Iterator[str]:
    """Warnings about the cloud, one sentence each."""
    if len(cloud) == 0:
        yield "there are no points"
        return
    if problem := length_problem(cloud.crs):
        yield f"{cloud.name} {problem}"
    if found := misplaced(cloud.crs, cloud.bounds):
        yield f"{cloud.name} {found.text}"
    if text := rounded_to_single(cloud.xyz):
        yield text
    if is_on_map(cloud.crs):
        problems = height_problem(cloud.xyz, cloud.metre), two_surveys(cloud.xyz, cloud.metre)
        yield from filter(None, problems)
    if has_numbers(cloud):
        returns = ReturnNumbers.of(cloud)
        if invalid := int((~returns.known).sum()):
            yield f"{invalid} points have a return number below 1 or above their number of returns"
        if returns.in_lists:
            yield "no pulse has a single return: are these lists of first and of last returns?"
    if "intensity" in cloud and not np.any(cloud["intensity"]):
        yield "all intensities are 0"
    if "classification" in cloud and (never := int((cloud["classification"] == 0).sum())):
        yield f"{never} points were never classified (class 0)"
    if "withheld" in cloud and (withheld := int(np.count_nonzero(cloud["withheld"]))):
        yield f"{withheld} points are flagged as withheld"
    yield from _gross_outliers(cloud)


def _gross_outliers(cloud: PointCloud) -> Iterator[str]:
    """Warnings about heights far outside of the range that holds 98 % of them."""
    z = cloud["z"]
    low, high = np.percentile(z, (1, 99))
    metre = 1.0 if length_problem(cloud.crs) else cloud.metre
    margin = RANGES * (high - low) + LEAST_MARGIN * metre
    if below := int((z < low - margin).sum()):
        yield f"{below} points lie far below all others (lowest {z.min():.2f})"
    if above := int((z > high + margin).sum()):
        yield f"{above} points lie far above all others (highest {z.max():.2f})"
