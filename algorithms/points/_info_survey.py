"""Properties of a survey from the headers of its files: totals, a row per file, and warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from pyproj import CRS

from toolbox.data import Survey, SurveyFile
from toolbox.data.area_of_use import centre_in_degrees, misplaced
from toolbox.data.crs import describe_crs, height_system, length_problem, vertical_unit

SEAM = 10.0  # mean point spacings; files closer to each other have no gap between them
BOUNDS = ("xmin", "ymin", "zmin", "xmax", "ymax", "zmax")

Row = dict[str, Any]


class Cover:
    """The area that the bounding boxes of the files cover, in square units of the coordinates.

    Attributes
    ----------
    area : in any file
    overlap : in more than one file
    beside : within the convex hull of all files, but in none of them
    holes : area of each hole, surrounded by files that meet; the seams between files, up to ten
        mean point spacings wide, are none
    """

    def __init__(self, survey: Survey) -> None:
        corners = np.array([f.bounds for f in survey.files if f.count]).reshape(-1, 6)
        boxes = shapely.box(*corners[:, [0, 1, 3, 4]].T)
        union = shapely.union_all(boxes)
        self.area = float(union.area)
        self.overlap = float(shapely.union_all(_common(boxes)).area)
        self.beside = float(union.convex_hull.area) - self.area
        seam = SEAM * np.sqrt(self.area / max(survey.count, 1)) / 2
        closed = union.buffer(seam, join_style="mitre").buffer(-seam, join_style="mitre")
        rings = [ring for part in shapely.get_parts(closed) for ring in part.interiors]
        self.holes = [float(shapely.Polygon(ring).area) for ring in rings]


def _common(boxes: Any) -> Any:
    """Intersections of all pairs of boxes that intersect."""
    one, other = shapely.STRtree(boxes).query(boxes, predicate="intersects")
    pairs = one < other
    return shapely.intersection(boxes[one[pairs]], boxes[other[pairs]])


def figures(survey: Survey, cover: Cover) -> Iterator[Row]:
    """Table rows: properties of the survey as a whole."""
    yield {"property": "survey", "value": survey.name}
    yield {"property": "files", "value": len(survey.files)}
    yield {"property": "points", "value": survey.count}
    yield {"property": "crs", "value": describe_crs(survey.crs) if survey.crs else None}
    if survey.crs:
        yield {"property": "heights", "value": height_system(survey.crs)}
    for name in survey.names:
        types = {kind for file in survey.files for n, kind, _ in file.attributes if n == name}
        listed = ", ".join(sorted(np.dtype(kind).name for kind in types))
        yield {"property": f"attribute {name}", "value": listed}
    if survey.count:
        unit = vertical_unit(survey.crs)
        for name, value in zip(BOUNDS, survey.bounds, strict=True):
            yield {"property": name, "value": value, "unit": unit if name[0] == "z" else ""}
        yield from place_on_earth(survey.crs, survey.bounds)
    yield from _areas(survey, cover)
    for text, count in Counter(map(_format, survey.files)).items():
        yield {"property": f"format {text}", "value": count, "unit": "files"}


def place_on_earth(crs: CRS | None, bounds: Sequence[float]) -> Iterator[Row]:
    """Table rows: latitude and longitude of the middle, where the CRS has them."""
    if found := centre_in_degrees(crs, bounds):
        names = ("longitude of the centre", "latitude of the centre")
        for name, value in zip(names, found, strict=True):
            yield {"property": name, "value": round(value, 5), "unit": "degrees"}


def _areas(survey: Survey, cover: Cover) -> Iterator[Row]:
    square = _square_metre(survey)
    unit = "m2" if length_problem(survey.crs) is None else "square unit"
    areas = {
        "covered area": cover.area,
        "overlap area": cover.overlap,
        "hull area without files": cover.beside,
        "hole area": sum(cover.holes),
    }
    for name, area in areas.items():
        yield {"property": name, "value": area / square, "unit": unit}
    yield {"property": "holes", "value": len(cover.holes)}
    if cover.area:
        density = survey.count * square / cover.area
        yield {"property": "density", "value": density, "unit": f"1/{unit}"}


def _square_metre(survey: Survey) -> float:
    """Area of a square metre in square units of the coordinates; 1 without a length unit."""
    return 1.0 if length_problem(survey.crs) else survey.metre**2


def _format(file: SurveyFile) -> str:
    suffix = "".join(file.path.suffixes[-2 if file.path.suffix == ".gz" else -1 :])
    lead = suffix.lstrip(".").upper()
    return f"{lead} {file.version}, point format {file.point_format}" if file.version else lead


def file_rows(survey: Survey) -> Iterator[Row]:
    """Table rows: one per file; the density is that of its bounding box."""
    square = _square_metre(survey)
    for file in survey.files:
        xmin, ymin, _, xmax, ymax, _ = file.bounds
        area = (xmax - xmin) * (ymax - ymin) if file.count else 0.0
        bounds = zip(BOUNDS, file.bounds if file.count else [None] * 6, strict=True)
        yield {
            "file": str(file.path),
            "points": file.count,
            **dict(bounds),
            "density": file.count * square / area if area > 0 else None,
            "format": _format(file),
        }


def warnings(survey: Survey) -> Iterator[str]:
    """Warnings about the survey, one sentence each."""
    if survey.count == 0:
        yield "there are no points"
    if problem := length_problem(survey.crs):
        yield f"{survey.name} {problem}"
    if found := misplaced(survey.crs, survey.bounds):
        yield f"{survey.name} {found.text}"
    for file in survey.files:
        if file.count == 0:
            yield f"{file.path.name} holds no points"
        for remark in file.remarks:
            yield f"{file.path.name} {remark}"
    having = Counter(name for file in survey.files for name, *_ in file.attributes)
    for name, count in having.items():
        if count < len(survey.files):
            yield f"only {count} of {len(survey.files)} files have the attribute {name}"
    if len({file.scales for file in survey.files}) > 1:
        yield "the files have several scales; read together, they get the finest"
    yield from _likely_copies(survey)


def _likely_copies(survey: Survey) -> Iterator[str]:
    seen: dict[Any, str] = {}
    for file in survey.files:
        if not file.count:
            continue
        first = seen.setdefault((file.count, file.bounds), file.path.name)
        if first != file.path.name:
            yield f"{file.path.name} has as many points and the same bounds as {first}"
