"""How well polygons agree with reference polygons, by area and by object.

What each figure means: docs/explanation/comparing-areas-and-lines.md.

References
----------
Odabaş (2018). MSc thesis, Karadeniz Technical University: shorelines of a reservoir, table 9;
similarity is the overlap over the area of the polygon itself.
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56:
completeness, correctness and quality.
Rutzinger, M., Rottensteiner, F. and Pfeifer, N. (2009). A comparison of evaluation techniques for
building extraction from airborne laser scanning. IEEE JSTARS 2(1), 11-20: objects that count as
found by their overlap, and the topology of what overlaps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.compare._overlay import (
    Array,
    Indices,
    Overlay,
    Pairs,
    Side,
    belonging,
)
from algorithms.compare._shapes import (
    AREAS,
    Shapes,
    attribute_problem,
    features,
    layer_problem,
    mended,
)
from algorithms.compare._unseen import warn_outside
from toolbox.context import QUIET, Context, log
from toolbox.data import Table, Vector
from toolbox.data.report import Column
from toolbox.declare import Extent, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

ROUNDING = 1e-9  # of an area: less than this is what calculation leaves
AGREE, COMMISSION, OMISSION = "agree", "commission", "omission"
SLIVERS, SLIVER_AREA = "slivers", "sliver_area"
RELATIONS = ("1:1", "1:n", "n:1", "n:m", "1:0", "0:1")

Row = dict[str, Any]
LOOKS = {  # each as the layer that is there alone has on the map of a report
    "agree": ("in both", "#6a3d9a"),
    "commission": ("only in the polygons", "#0b5fa5"),
    "omission": ("only in the reference", "#d7261e"),
}


@tool(
    "compare.areas",
    title="Compare areas",
    tags=(
        "accuracy",
        "iou",
        "completeness",
        "correctness",
        "polygon",
        "footprint",
        "validation",
        "map",
        "change",
    ),
)
class CompareAreas:
    """Compare polygons with reference polygons, by area and one by one.

    Overlap is the area that both layers cover, commission what only the polygons cover, omission
    what only the reference covers. Similarity is the overlap over the area of the polygons
    (correctness), completeness the overlap over the area of the reference, and IoU the overlap over
    the area that either covers. Area that polygons of one layer cover twice counts once in all
    sums, and is reported; the row of a polygon is about this polygon alone.

    With `coverage` or `extent` all polygons are cut to the area in which both layers are complete.
    If the polygons are some of many, such as one lake of a map of all lakes, `counterparts` leaves
    out the parts of the reference that belong to none of them, and tells how much that is. A part
    belongs to a polygon by a tenth of the smaller of both, or by the largest overlap with it.

    As an object, a polygon is found if the other layer covers at least `min_overlap` of its area,
    however many polygons that takes. It is paired if the IoU with a single polygon of the other
    layer is at least `min_overlap`; each polygon is in at most one pair, those of the highest IoU
    come first. Only polygons of at least `min_area` are judged so; smaller ones still count
    as area, and as counterparts.

    Outlines are not known better than their points or cells allow: slivers of difference that are
    smaller than a square of `detail` are left out of `difference`. The table tells how many, and
    their area, which stays in all figures.

    The relation tells how many polygons belong to how many of the reference, by overlaps of
    at least `min_overlap` of the smaller one: 1:1, 1:n (merged), n:1 (split), n:m, 1:0 and 0:1.

    Polygons that are not valid are refused by number, counted from 1; `repair` rebuilds them.
    Tables are in metres, layers in the unit of the data.
    """

    areas: Vector = source("Polygons to judge", shapes="polygon")
    reference: Vector = source("Reference polygons", shapes="polygon")
    coverage: Vector | None = source(
        "Polygons within which is compared",
        default=None,
        label="Area to compare in",
        shapes="polygon",
    )
    extent: Extent | None = param("Rectangle to work in; that of the data by default", default=None)
    min_area: float = param(
        "Area from which a polygon is judged as an object",
        default=0.0,
        unit="m2",
        ge=0,
        label="Smallest object",
    )
    detail: float | None = param(
        "Leave differences smaller than a square of this side out of the layer of differences",
        default=None,
        unit="m",
        gt=0,
        label="Detail of the outlines",
    )
    min_overlap: float = param(
        "Least intersection over union of a pair, or share of its area that must be covered",
        default=0.5,
        unit="1",
        gt=0,
        le=1,
        label="Least overlap",
    )
    counterparts: bool = param(
        "Compare only the parts of the reference that belong to one of the polygons",
        default=False,
        label="Only what has a counterpart",
    )
    label: str | None = param(
        "Attribute that names polygons in the table",
        default=None,
        of="areas",
        label="Attribute with names",
    )
    repair: bool = param(
        "Rebuild polygons that are not valid, and leave out those without geometry",
        default=False,
        label="Repair polygons",
    )

    @outputs
    class Outputs:
        table: Table = sink("One row per measure: measure, value, unit, meaning")
        polygons: Table = sink("One row per polygon of either layer")
        difference: Vector = sink(
            "Polygons of the kinds agree, commission and omission, the largest first",
            show=show.Classes("kind", LOOKS),
            columns={
                "kind": Column("Kind", names={word: name for word, (name, _) in LOOKS.items()}),
                "area": Column("Area", "unit²", 1),
                "polygon": Column("Number of the polygon"),
                "reference": Column("Number of the reference"),
            },
        )
        area: float = sink("Area of the polygons", unit="m2")
        reference_area: float = sink("Area of the reference", unit="m2")
        overlap: float = sink("Area that both cover", unit="m2")
        area_error: float | None = sink("Area minus reference, over reference", unit="%")
        similarity: float | None = sink("Overlap over the area of the polygons", unit="%")
        completeness: float | None = sink("Overlap over the area of the reference", unit="%")
        iou: float | None = sink("Overlap over the area that either covers", unit="%")
        object_correctness: float | None = sink("Polygons found in the reference", unit="%")
        object_completeness: float | None = sink("Reference polygons found", unit="%")

        def in_words(self) -> str:
            """How the areas agree."""
            told = (
                f"The polygons cover {self.area:.0f} m², the reference {self.reference_area:.0f} "
                f"m², both {self.overlap:.0f} m²"
            )
            if self.iou is None or self.completeness is None or self.similarity is None:
                return f"{told}."
            return (
                f"{told}: {self.completeness:.1f} % of the reference are found, "
                f"{self.similarity:.1f} % of what is found are in the reference, and the "
                f"intersection is {self.iou:.1f} % of the union.{self._slivers()}"
            )

        def _slivers(self) -> str:
            """How many differences are too small to be listed; "" for none."""
            values = dict(zip(self.table.frame["measure"], self.table.frame["value"], strict=True))
            count = values.get(SLIVERS, 0)
            if not count:
                return ""
            return (
                f" {count:.0f} differences are smaller than the outlines are known, "
                f"{values[SLIVER_AREA]:.1f} m² in all: they are in the figures, and in no list."
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The layers hold valid polygons, and one of them has the attribute `label`."""
        for name in ("areas", "reference", "coverage"):
            layer = getattr(self, name)
            if layer is None:
                continue
            if text := layer_problem(layer, AREAS, "polygons", repair=self.repair):
                yield name, text
        if self.coverage is not None and not len(self.coverage):
            yield "coverage", f"{self.coverage.name or 'the layer'} has no polygons"
        if self.label is not None:
            for text in attribute_problem(self.label, (self.areas, self.reference)):
                yield "label", text

    def halo(self) -> float:
        """Infinite, as polygons are of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CompareAreas.Outputs:
        """Cut to the coverage, overlay, and sum up."""
        import pandas as pd

        region = self._region()
        own = Side.of(mended(self.areas, "areas"), region, ctx.part(0.0, 0.15))
        reference = mended(self.reference, "reference")
        if self.counterparts:
            reference = _of_polygons(own, reference, region, self.areas.metre)
        other = Side.of(reference, region, ctx.part(0.15, 0.3))
        if region is not None and not (own.total or other.total):
            where = "coverage" if self.coverage is not None else "extent"
            raise DataError(f"{where}: no polygon of either layer lies within")
        _warn(own, other, self.areas.metre, counterparts=self.counterparts)
        overlay = Overlay.of(own, other, ctx.part(0.3, 0.9))
        covered = overlay.covered, overlay.covered_reference
        objects = Objects.of(own, other, covered, overlay.pairs, self.min_area, self.min_overlap)
        ctx.progress(0.95)
        unit = self.areas.metre  # of the data in one metre
        sums = Sums.of(own, other, overlay)
        if sums.area and sums.reference and not sums.overlap:
            log.warning("no polygon overlaps the reference; do they lie at the same place?")
        elif region is None:
            warn_outside(other.shapes, own.shapes, "reference", "areas")
            warn_outside(own.shapes, other.shapes, "areas", "reference")
        names, known = self._labels(self.areas), self._labels(self.reference)
        each = [
            polygon_frame("areas", own, covered[0], objects.own, names, unit),
            polygon_frame("reference", other, covered[1], objects.other, known, unit),
        ]
        difference, slivers = self._difference(overlay)
        ctx.progress(1.0)
        return self.Outputs(
            table=Table.from_rows([*sums.rows(unit), *slivers, *objects.rows()]),
            polygons=Table(pd.concat(each, ignore_index=True)),
            difference=difference,
            area=sums.area,
            reference_area=sums.reference,
            overlap=sums.overlap,
            area_error=percent(sums.area - sums.reference, sums.reference),
            similarity=percent(sums.overlap, sums.area),
            completeness=percent(sums.overlap, sums.reference),
            iou=percent(sums.overlap, sums.union),
            object_correctness=objects.own.found_share,
            object_completeness=objects.other.found_share,
        )

    def _region(self) -> Any:
        """The area that is compared, as one geometry; None for everywhere.

        Raises
        ------
        DataError
            Coverage and extent have nothing in common.
        """
        box = shapely.box(*self.extent) if self.extent else None
        if self.coverage is None:
            return box
        region = shapely.union_all(mended(self.coverage, "coverage"))
        if box is not None:
            region = region.intersection(box)
        if region.area == 0:
            raise DataError("coverage: has no area" + (" in the extent" if box else ""))
        return region

    def _labels(self, layer: Vector) -> list[Any]:
        """The label of each feature; None where it has none."""
        frame = layer.frame
        if self.label is None or self.label not in frame:
            return [None] * len(frame)
        column = frame[self.label].astype(object)
        return list(column.where(column.notna(), None))

    def _difference(self, overlay: Overlay) -> tuple[Vector, list[Row]]:
        """Layer of agreement, commission and omission, with the numbers of the features.

        Rows of the table tell what is left out of it, if a detail is given.
        """
        import geopandas
        import pandas as pd

        pairs = overlay.exact
        none = np.full(max(len(overlay.commission), len(overlay.omission)), -1)
        kinds = [
            (AGREE, pairs.shape, pairs.first, pairs.second),
            (COMMISSION, overlay.commission, np.arange(len(overlay.commission)), none),
            (OMISSION, overlay.omission, none, np.arange(len(overlay.omission))),
        ]
        frames = []
        for kind, shapes, first, second in kinds:
            parts, index = shapely.get_parts(shapes, return_index=True)
            area = shapely.area(parts)
            parts, index, area = parts[area > 0], index[area > 0], area[area > 0]
            columns = {"kind": kind, "area": area}
            columns |= {"polygon": numbered(first[index]), "reference": numbered(second[index])}
            frames.append(geopandas.GeoDataFrame(columns, geometry=parts, crs=self.areas.crs))
        frame = pd.concat(frames, ignore_index=True)
        frame = frame.sort_values("area", ascending=False, kind="stable", ignore_index=True)
        if self.detail is None:
            return Vector(frame, geometry_type="Polygon"), []
        small = (frame["kind"] != AGREE) & (frame["area"] < self.detail**2 * (1 - ROUNDING))
        left_out = float(frame["area"][small].sum()) / self.areas.metre**2
        told = "differences smaller than the detail, which are in no list"
        rows = [
            _row(SLIVERS, small.sum(), "1", told),
            _row(SLIVER_AREA, left_out, "m2", "their area, which is in all figures"),
        ]
        kept = frame[~small].reset_index(drop=True)
        return Vector(kept, geometry_type="Polygon"), rows


def _of_polygons(own: Side, reference: Shapes, region: Any, metre: float) -> Shapes:
    """The reference without what belongs to none of the polygons, which is logged."""
    kept = belonging(own.shapes, reference, region)
    whole, left = shapely.area(reference), shapely.area(kept)
    log.info(
        "reference: compared with %d of %d polygons; %.1f of %.1f m2 belong to none of the "
        "polygons and are left out",
        np.count_nonzero(left),
        np.count_nonzero(whole),
        (whole.sum() - left.sum()) / metre**2,
        whole.sum() / metre**2,
    )
    return kept


def _warn(own: Side, other: Side, metre: float, *, counterparts: bool) -> None:
    """Log what may not be as the user intended."""
    for name, side in (("areas", own), ("reference", other)):
        if counterparts and len(other.area) and side is other and not side.area.any():
            log.warning(
                "reference: no polygon of the reference belongs to what is compared with it: is it "
                "of another place, or does it lack these polygons?"
            )
        elif not side.area.any():
            log.warning("%s: there are no polygons to compare", name)
        if side.twice > ROUNDING * side.area.sum():
            log.warning(
                "%s: polygons lie over each other (%s), by %.3f m2 in all; sums count this area "
                "once",
                name,
                features(side.covering),
                side.twice / metre**2,
            )


def numbered(indices: Indices) -> Any:
    """Feature numbers, which count from 1; missing where the index is -1."""
    import pandas as pd

    return pd.arrays.IntegerArray(indices.astype(np.int64) + 1, indices < 0)


def percent(part: float, whole: float) -> float | None:
    """A share in percent; None if the whole is zero."""
    return 100 * part / whole if whole else None


# By area --------------------------------------------------------------------------------------


class Sums(NamedTuple):
    """Areas of the layers, in the unit of the data."""

    area: float
    reference: float
    overlap: float
    commission: float
    omission: float
    twice: float
    reference_twice: float
    perimeter: float
    reference_perimeter: float

    @classmethod
    def of(cls, own: Side, other: Side, overlay: Overlay) -> Sums:
        """Sum up the areas of both layers; overlaps within a layer count once."""
        return cls(
            own.total,
            other.total,
            float(overlay.exact.area.sum()),
            float(shapely.area(overlay.commission).sum()),
            float(shapely.area(overlay.omission).sum()),
            own.twice,
            other.twice,
            float(shapely.length(own.shapes).sum()),
            float(shapely.length(other.shapes).sum()),
        )

    @property
    def union(self) -> float:
        """Area that either layer covers."""
        return self.overlap + self.commission + self.omission

    def rows(self, metre: float) -> Iterator[Row]:
        """One row per measure, in metres.

        Parameters
        ----------
        metre : length of one metre in the unit of the data
        """
        error, wrong = self.area - self.reference, self.commission + self.omission
        areas = {
            "area": (self.area, "area of the polygons"),
            "reference_area": (self.reference, "area of the reference"),
            "overlap": (self.overlap, "area that both cover"),
            "commission": (self.commission, "area of the polygons alone"),
            "omission": (self.omission, "area of the reference alone"),
            "union": (self.union, "area that either covers"),
            "area_difference": (error, "area of the polygons minus reference"),
            "counted_once": (self.twice, "area by which polygons lie over each other"),
            "reference_counted_once": (self.reference_twice, "the same of the reference"),
        }
        for name, (value, meaning) in areas.items():
            yield _row(name, value / metre**2, "m2", meaning)
        yield _row("perimeter", self.perimeter / metre, "m", "outlines and holes of the polygons")
        yield _row("reference_perimeter", self.reference_perimeter / metre, "m", "the same of it")
        width = wrong / self.reference_perimeter / metre if self.reference_perimeter else None
        yield _row("mean_offset", width, "m", "commission and omission over reference_perimeter")
        shares = {
            "similarity": (self.overlap, self.area, "overlap / area (correctness)"),
            "completeness": (self.overlap, self.reference, "overlap / reference_area"),
            "iou": (self.overlap, self.union, "overlap / union (quality)"),
            "f1": (2 * self.overlap, self.area + self.reference, "2 overlap / (both areas)"),
            "area_error": (error, self.reference, "area_difference / reference_area"),
        }
        for name, (part, whole, meaning) in shares.items():
            yield _row(name, percent(part, whole), "%", meaning)


def _row(measure: str, value: float | None, unit: str, meaning: str) -> Row:
    return {
        "measure": measure,
        "value": None if value is None else float(value),
        "unit": unit,
        "meaning": meaning,
    }


# By object ------------------------------------------------------------------------------------


class Judged(NamedTuple):
    """Outcome of each polygon of one layer as an object; arrays of shape (n,), -1 for no index.

    Attributes
    ----------
    counts : whether it is judged at all
    found : whether the other layer covers enough of it
    best, best_iou : polygon of the other layer with the highest IoU
    pair : polygon that it is paired with
    relation : such as "1:n", polygons to reference
    """

    counts: NDArray[np.bool_]
    found: NDArray[np.bool_]
    best: Indices
    best_iou: Array
    pair: Indices
    relation: NDArray[Any]

    @property
    def found_share(self) -> float | None:
        """Percentage of the judged polygons that were found."""
        return percent(int((self.found & self.counts).sum()), int(self.counts.sum()))

    @property
    def paired_share(self) -> float | None:
        """Percentage of the judged polygons that are paired."""
        return percent(int(((self.pair >= 0) & self.counts).sum()), int(self.counts.sum()))


class Objects(NamedTuple):
    """Outcomes of the polygons of both layers as objects."""

    own: Judged
    other: Judged
    relations: dict[str, int]

    @classmethod
    def of(
        cls,
        own: Side,
        other: Side,
        covered: tuple[Array, Array],
        pairs: Pairs,
        min_area: float,
        min_overlap: float,
    ) -> Objects:
        """Match the polygons of both layers.

        Parameters
        ----------
        covered : area of each polygon that the other layer covers, for both layers
        pairs : of polygons
        min_area : in the unit of the data
        min_overlap : share
        """
        least = min_overlap * (1 - ROUNDING)
        i, j = pairs.first, pairs.second
        iou = pairs.area / (own.area[i] + other.area[j] - pairs.area)
        of_smaller = pairs.area / np.minimum(own.area[i], other.area[j])
        pair, pair_other = one_to_one(i, j, iou, least, (len(own.area), len(other.area)))
        linked = of_smaller >= least
        kind, kind_other, counts = relations(i[linked], j[linked], own.area > 0, other.area > 0)
        judged = []
        for side, mine, theirs, area, mate, relation in (
            (own, i, j, covered[0], pair, kind),
            (other, j, i, covered[1], pair_other, kind_other),
        ):
            best, best_iou = highest(mine, theirs, iou, len(side.area))
            counted = (side.area > 0) & (side.area >= min_area * (1 - ROUNDING))
            found = counted & (area >= least * side.area)
            judged.append(Judged(counted, found, best, best_iou, mate, relation))
        return cls(judged[0], judged[1], counts)

    def rows(self) -> Iterator[Row]:
        """Table rows: counts and shares of objects."""
        for word, name, side in (
            ("", "polygons", self.own),
            ("reference_", "reference", self.other),
        ):
            yield _row(f"{word}objects", side.counts.sum(), "1", f"{name} judged as objects")
            yield _row(f"{word}objects_found", side.found.sum(), "1", f"{name} found")
            paired = (side.counts & (side.pair >= 0)).sum()
            yield _row(f"{word}objects_paired", paired, "1", f"{name} paired one to one")
        own, other = self.own, self.other
        for name, part, whole in (
            ("object", own.found_share, other.found_share),
            ("pair", own.paired_share, other.paired_share),
        ):
            what = "found" if name == "object" else "paired one to one"
            yield _row(f"{name}_correctness", part, "%", f"polygons {what}, of those judged")
            yield _row(f"{name}_completeness", whole, "%", f"reference polygons {what}")
        for relation, count in self.relations.items():
            yield _row(f"relation {relation}", count, "1", "groups, polygons to reference")


def highest(mine: Indices, theirs: Indices, value: Array, count: int) -> tuple[Indices, Array]:
    """The counterpart of highest value for each polygon, the first of equal ones; -1 for none.

    Parameters
    ----------
    mine, theirs, value : arrays of shape (m,)
    count : number of polygons, n

    Returns
    -------
    arrays of shape (n,), counterpart and value
    """
    best, top = np.full(count, -1), np.zeros(count)
    order = np.lexsort([-theirs, value])  # the last one written stays
    best[mine[order]], top[mine[order]] = theirs[order], value[order]
    return best, top


def one_to_one(
    first: Indices, second: Indices, iou: Array, least: float, counts: tuple[int, int]
) -> tuple[Indices, Indices]:
    """Pairs of polygons in the order of falling IoU, each polygon in at most one.

    Returns
    -------
    arrays of shape (n,) and (m,), index of the partner or -1
    """
    mate, mate_other = np.full(counts[0], -1), np.full(counts[1], -1)
    good = np.flatnonzero(iou >= least)
    for pair in good[np.lexsort([second[good], first[good], -iou[good]])].tolist():
        i, j = first[pair], second[pair]
        if mate[i] < 0 and mate_other[j] < 0:
            mate[i], mate_other[j] = j, i
    return mate, mate_other


def relations(
    first: Indices, second: Indices, there: NDArray[np.bool_], there_other: NDArray[np.bool_]
) -> tuple[NDArray[Any], NDArray[Any], dict[str, int]]:
    """Relation of each polygon (such as "1:n") by the groups of overlapping polygons.

    Parameters
    ----------
    first, second : arrays of shape (k,), polygons that belong to each other
    there, there_other : arrays of shape (n,) and (m,), polygons that are not empty

    Returns
    -------
    texts of shape (n,) and (m,), and the number of groups by text
    """
    n, total = len(there), len(there) + len(there_other)
    edges = coo_array((np.ones(len(first)), (first, second + n)), (total, total))
    groups, group = connected_components(edges, directed=False)
    mine = np.bincount(group[:n], there, groups).astype(int)
    theirs = np.bincount(group[n:], there_other, groups).astype(int)
    text = np.array([_relation(a, b) for a, b in zip(mine, theirs, strict=True)], object)
    counts = {kind: int((text == kind).sum()) for kind in RELATIONS}
    return text[group[:n]], text[group[n:]], counts


def _relation(own: int, other: int) -> str:
    if own > 1 and other > 1:
        return "n:m"
    return f"{own if own < 2 else 'n'}:{other if other < 2 else 'n'}"


def polygon_frame(
    layer: str, side: Side, covered: Array, judged: Judged, labels: list[Any], metre: float
) -> Any:
    """One row per polygon, in metres; numbers count from 1."""
    import pandas as pd

    area = side.area / metre**2
    overlap = np.minimum(covered / metre**2, area)
    return pd.DataFrame(
        {
            "layer": np.full(len(area), layer, object),
            "number": np.arange(1, len(area) + 1),
            "label": pd.Series(labels, dtype=object),
            "area_m2": area,
            "overlap_m2": overlap,
            "alone_m2": area - overlap,
            "overlap_%": 100 * np.divide(overlap, area, out=np.zeros(len(area)), where=area > 0),
            "perimeter_m": shapely.length(side.shapes) / metre,
            "inside_%": 100 * side.inside,
            "best": numbered(judged.best),
            "best_iou_%": 100 * judged.best_iou,
            "pair": numbered(judged.pair),
            "relation": judged.relation,
            "judged": judged.counts,
            "found": judged.found,
        }
    )
