"""Planes found with each of several tolerances, to choose the one that suits a scan.

References
----------
Çömert, R. and Avdan, U. (RANSAC façade planes from terrestrial scans): table 1, from 26 planes at
2 cm to 11 at 6 cm, of which the first is taken after which their number stays the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

from algorithms.planes import _parameters as options
from algorithms.planes._cells import ROUNDING
from algorithms.planes._fronts import fronts_of, pieces
from algorithms.planes._search import Orientation, Rules, steepness
from algorithms.planes._segment import NOISES, cells_of, segment_cells
from algorithms.shared import parameters
from algorithms.shared.ground import is_withheld
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.data.report import Column
from toolbox.declare import outputs, param, show, sink, source, tool

OF_NOISE = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0)  # tolerances by default
SETTLED_PIECES = 0.1  # share by which the next tolerance lowers the pieces of fronts that are whole
SETTLED_PLANES, SETTLED_SHARE = 0.02, 0.001  # changes that are none: of the number, of all points


@tool(
    "planes.sweep",
    title="Try tolerances of planes",
    tags=(
        "plane",
        "tolerance",
        "ransac",
        "parameter",
    ),
)
class PlanesSweep:
    """Find planes with several tolerances, to see which suits the scan.

    With a tolerance below the noise of the scan only the middle of a wall is found, or the wall in
    pieces; one that is too large takes in what lies beside it. Between the two there is a range
    in which little changes. The knee is the first tolerance after which the next one changes
    the number of planes by no more than 2 % and the share of points on planes by no more than
    0.1 points in a hundred. There is none if they go on changing, as on bent surfaces.

    Fronts fall to pieces with a tolerance below the depth of what is on a wall, whether there is a
    knee or not. `pieces` is the number of planes of a front, each counted by its share of the
    points (Simpson), and `whole` the first tolerance after which no further step lowers it by more
    than a tenth.

    By default tolerances from one to ten times the noise of the scan are tried. The other settings
    are those of planes.extract.
    """

    points: PointCloud = source("Points of a scan, or of several put together")
    tolerances: tuple[float, ...] | None = param(
        "Tolerances to try; by default multiples of the noise", default=None, unit="m", gt=0
    )
    max_angle: float = options.max_angle()
    min_points: int = options.min_points()
    min_extent: float = options.min_extent()
    plane_gap: float | Literal["auto"] = options.plane_gap()
    orientation: Orientation = options.orientation()
    orientation_angle: float = options.orientation_angle()
    front_depth: float = options.front_depth()
    seed: int = parameters.seed()

    @outputs
    class Outputs:
        table: Table = sink(
            "One row per tolerance: planes, share of points on them, distances",
            show=show.Curve(
                show.Axis("tolerance", "tolerance", "cm", factor=100),
                (
                    show.Axis("planes", "planes"),
                    show.Axis("share", "points on planes", "%", from_zero=False),
                ),
                dots=True,
                dashed="knee",
            ),
            columns={
                "tolerance": Column("Tolerance", "m", 4),
                "share": Column("Points on planes", "%", 1),
                "largest": Column("Points of the largest plane"),
            },
        )
        knee: float | None = sink("First tolerance after which little changes", unit="m")
        whole: float | None = sink("First tolerance after which fronts stay whole", unit="m")
        auto: float = sink("Tolerance that planes.extract takes by itself", unit="m")
        noise: float = sink("Standard deviation of points about small planes", unit="m")

    def check(self) -> Iterator[tuple[str, str]]:
        """At least two tolerances are given."""
        if self.tolerances is not None and len(set(self.tolerances)) < 2:
            yield "tolerances", f"give at least two, got {list(self.tolerances)}"

    def halo(self) -> float:
        """Infinite, as planes are of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesSweep.Outputs:
        """Find the planes with each tolerance."""
        cloud, used = self.points, ~is_withheld(self.points)
        xyz = cloud.xyz if used.all() else cloud.xyz[used]
        cells = cells_of(xyz, ctx=ctx.part(0.0, 0.1))
        least = ROUNDING * cells.size
        tries = self.tolerances or [k * max(cells.noise, least) for k in OF_NOISE]
        rows: list[dict[str, Any]] = []
        for number, tolerance in enumerate(sorted(set(tries))):
            part = ctx.part(0.1 + 0.9 * number / len(tries), 0.1 + 0.9 * (number + 1) / len(tries))
            found = segment_cells(cells, self._rules(tolerance), ctx=part)
            fronts = fronts_of(
                xyz, found.ids, found.planes, depth=self.front_depth, metre=cloud.metre
            )
            sizes = np.bincount(found.ids, minlength=len(found.planes) + 1)[1:]
            rows.append(
                {
                    "tolerance": tolerance / cloud.metre,
                    "planes": len(found.planes),
                    "share": 100 * float((found.ids > 0).mean()),
                    "largest": int(np.bincount(found.ids, minlength=2)[1]),
                    "trials": found.trials,
                    "fronts": len(fronts),
                    "pieces": pieces(fronts, sizes),
                    "knee": False,
                }
            )
        place = knee([row["planes"] for row in rows], [row["share"] for row in rows])
        kept = whole([row["pieces"] for row in rows])
        if place is None:
            log.warning("the number of planes and their points go on changing: there is no knee")
        else:
            rows[place]["knee"] = True
        ctx.progress(1.0)
        return self.Outputs(
            table=Table.from_rows(rows),
            knee=None if place is None else sorted(set(tries))[place],
            whole=None if kept is None else sorted(set(tries))[kept],
            auto=NOISES * cells.noise,
            noise=cells.noise,
        )

    def _rules(self, tolerance: float) -> Rules:
        return Rules(
            tolerance=tolerance,
            angle=math.radians(self.max_angle),
            gap=0.0 if self.plane_gap == "auto" else self.plane_gap,
            min_points=self.min_points,
            min_extent=self.min_extent,
            steep=steepness(self.orientation, self.orientation_angle),
            seed=self.seed,
        )


def knee(planes: Sequence[int], shares: Sequence[float] | None = None) -> int | None:
    """Index of the first tolerance after which the next one changes little; None if there is none.

    Parameters
    ----------
    planes : numbers of planes by rising tolerance
    shares : of points on them, percent; not looked at unless given

    Examples
    --------
    >>> knee([26, 18, 16, 14, 13, 12, 12, 11])  # 5.0 cm in table 1 of Çömert and Avdan
    5
    """
    for place in range(len(planes) - 1):
        change = abs(planes[place + 1] - planes[place])
        if change > SETTLED_PLANES * planes[place] or not planes[place]:
            continue
        if shares and abs(shares[place + 1] - shares[place]) > 100 * SETTLED_SHARE:
            continue
        return place
    return None


def whole(pieces: Sequence[float]) -> int | None:
    """Index of the first tolerance after which fronts keep their pieces; None if they never do.

    Parameters
    ----------
    pieces : of fronts, by rising tolerance; NaN where there is no front

    Examples
    --------
    >>> whole([17.0, 9.0, 9.0, 5.0, 2.1, 2.0, 1.9])
    4
    """
    fewest = 1 - SETTLED_PIECES
    first = next((k for k, count in enumerate(pieces) if count > 0), len(pieces))
    steps = range(first, len(pieces) - 1)
    lowered = [k + 1 for k in steps if not pieces[k + 1] >= fewest * pieces[k]]
    place = lowered[-1] if lowered else first
    return place if place < len(pieces) - 1 else None
