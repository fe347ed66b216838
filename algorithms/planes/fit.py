"""The plane that most points are near to, and how well they fit it.

The method and its papers: algorithms/shared/plane_fit.py. What the numbers mean, and how it
compares: docs/explanation/planes-fit.md.
"""

from __future__ import annotations

import math

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.planes._figures import LEVEL, UP, Figures, figures
from algorithms.shared import parameters
from algorithms.shared.ground import is_withheld
from algorithms.shared.lowest import require_finite
from algorithms.shared.plane_fit import Cone, Fit, Plane, fit, is_line, sample, search
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.data.crs import vertical_unit
from toolbox.declare import Direction, Share, outputs, param, sink, source, tool
from toolbox.errors import DataError

NAME = "PlaneDistance"

Floats = NDArray[np.float64]


@tool(
    "planes.fit",
    title="Fit a plane",
    tags=(
        "plane",
        "ransac",
        "msac",
        "normal",
    ),
)
class PlanesFit:
    """Fit a plane to the points that lie near it, whatever the others are (RANSAC, MSAC).

    Planes through three random points are tried, and the one is taken that most points support, the
    nearer the better. The number of trials follows from the share of points on the best plane so
    far, so that three points of the plane are drawn at once with the given `confidence`. Then the
    plane with the least squares of distances is fitted to all points within `max_distance`, and
    again until they stay the same.

    With a `reference` direction, such as 0,0,1 for level planes, only planes are tried whose normal
    is within `reference_angle` of it. The normal then points to the side of the reference,
    otherwise upwards. Withheld points take no part.

    The attribute PlaneDistance is the distance of each point, above zero on the side of the normal,
    in the unit of the data. In the layer of the plane all lengths are in that unit, too.
    """

    points: PointCloud = source("Points, some of which lie on a plane")
    max_distance: float = param(
        "Farthest point that belongs to the plane",
        default=0.2,
        unit="m",
        gt=0,
        label="Distance of points from the plane",
    )
    reference: Direction | None = param(
        "Direction x,y,z of the normal; any by default", default=None
    )
    reference_angle: float = param(
        "Largest angle between the normal and the reference", default=5.0, unit="deg", gt=0, le=90
    )
    confidence: float = param(
        "Probability that the best plane is among those drawn",
        default=0.99,
        unit="1",
        gt=0,
        lt=1,
    )
    max_trials: int = param("Draws at most", default=10_000, unit="1", ge=1, label="Most trials")
    seed: int = parameters.seed()

    @outputs
    class Outputs:
        inliers: PointCloud = sink(
            "Points near the plane, with PlaneDistance", label="Points of the plane"
        )
        outliers: PointCloud = sink("All other points, with PlaneDistance", label="Other points")
        plane: Vector = sink("Smallest rectangle in the plane around its points, with all numbers")
        normal_x: float = sink("Normal of the plane, eastwards", unit="1")
        normal_y: float = sink("Normal of the plane, northwards", unit="1")
        normal_z: float = sink("Normal of the plane, upwards", unit="1")
        offset: float = sink(
            "Distance of the plane from the zero of the coordinates, along the normal",
            unit="m",
            label="Distance from the origin",
        )
        height: float = sink("Height of the plane in the middle of its points", unit="m")
        tilt: float = sink("Angle between the plane and the horizontal", unit="deg")
        azimuth: float = sink(
            "Where the plane falls to, from north clockwise; NaN if it is level", unit="deg"
        )
        inlier_share: float = sink("Share of points near the plane", unit="1")
        rms: float = sink(
            "Root mean square of the distances of these points", unit="m", label="RMS"
        )
        standard_error: float = sink(
            "Standard deviation of a distance; NaN of three points", unit="m"
        )
        trials: int = sink("Trials that were made", unit="1")

    def halo(self) -> float:
        """Infinite, as the plane is that of all points."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesFit.Outputs:
        """Find the plane and fit it."""
        cloud, used = self.points, ~is_withheld(self.points)
        xyz = cloud.xyz if used.all() else cloud.xyz[used]
        cone = Cone.of(np.array(self.reference), self.reference_angle) if self.reference else None
        fitted, trials = best_plane(
            xyz,
            self.max_distance,
            cone=cone,
            confidence=self.confidence,
            max_trials=self.max_trials,
            seed=self.seed,
            ctx=ctx.part(0.0, 0.9),
        )
        plane = fitted.plane.turned(UP if cone is None else cone.axis)
        away = plane.distances(cloud.xyz)
        near = (np.abs(away) <= self.max_distance) & used
        ctx.progress(0.95)
        found = figures(plane, away[near])
        unit = f", {vertical_unit(cloud.crs)}" if cloud.crs else ""
        measured = cloud.with_attributes(
            {NAME: away.astype(np.float32)}, descriptions={NAME: f"from the plane{unit}"}
        )
        share = Share.of_points(near, cloud.core)
        features = rectangle(plane, cloud.xyz[near], found, share)
        layer = geopandas.GeoDataFrame(**features, crs=cloud.crs)
        ctx.progress(1.0)
        return self.Outputs(
            inliers=measured.select(near),
            outliers=measured.select(~near),
            plane=Vector(layer, name="plane", geometry_type="Polygon Z"),
            inlier_share=share,
            trials=trials,
            **found._asdict(),
        )


def best_plane(
    xyz: Floats,
    max_distance: float,
    *,
    cone: Cone | None = None,
    confidence: float = 0.99,
    max_trials: int = 10_000,
    seed: int = 0,
    ctx: Context = QUIET,
) -> tuple[Fit, int]:
    """The plane with the most points within the distance, fitted to these.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    max_distance : of a point on the plane, in the unit of xyz
    cone : normals that are allowed
    confidence, max_trials, seed : see :class:`PlanesFit`
    ctx : progress and cancellation

    Returns
    -------
    the fit, the same for any order of the points, and how many trials were made

    Raises
    ------
    DataError
        There are fewer than three points, all are on a line, or no plane is in the cone.
    """
    require_finite(xyz)
    if len(xyz) < 3:
        raise DataError(f"points: a plane needs 3 points, there are {len(xyz)}")
    some = sample(xyz, seed)
    if is_line(some):
        raise DataError(f"points: all {len(xyz)} are on a line or at one place, not on a plane")
    plane, trials = search(
        some,
        max_distance,
        cone=cone,
        confidence=confidence,
        max_trials=max_trials,
        seed=seed,
        ctx=ctx.part(0.0, 0.7),
    )
    if plane is None:
        angle = math.degrees(math.acos(cone.cosine)) if cone else 0.0
        where = f" within {angle:.4g} degrees of the reference" if cone else ""
        raise DataError(f"points: {trials} trials found no plane{where}")
    fitted = fit(xyz, plane, max_distance, cone=cone, ctx=ctx.part(0.7, 1.0))
    fitted = fitted or Fit(plane, settled=False)
    if not fitted.settled:
        log.warning(
            "the fit did not settle; points near max_distance come and go, or the cone ends"
        )
    return fitted, trials


def rectangle(plane: Plane, xyz: Floats, found: Figures, share: float) -> dict[str, object]:
    """The smallest rectangle in the plane around points of shape (m, 3), and its attributes.

    Returns
    -------
    dict
        Data and geometry of a GeoDataFrame of one feature.
    """
    along = np.cross([0.0, 0.0, 1.0], plane.normal)  # level, unless the plane is
    if np.linalg.norm(along) <= LEVEL:
        along = np.array([1.0, 0.0, 0.0])
    along /= np.linalg.norm(along)
    axes = np.array([along, np.cross(plane.normal, along)])
    places = ((xyz - plane.origin) - plane.centre) @ axes.T
    flat = shapely.oriented_envelope(shapely.convex_hull(shapely.multipoints(places)))
    corners = shapely.get_coordinates(flat) @ axes + (plane.centre + plane.origin)
    centre = plane.centre + plane.origin
    numbers = {f"centre_{axis}": [value] for axis, value in zip("xyz", centre, strict=True)}
    numbers |= {name: [value] for name, value in found._asdict().items()}
    numbers |= {"points": [len(xyz)], "inlier_share": [float(share)]}
    return {"data": numbers, "geometry": [shapely.Polygon(corners)]}
