"""Covariance features of the neighbourhood of every point, as attributes.

What they are and where they come from: :mod:`algorithms.shared.covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.covariance import FEATURES, Name, covariance_features
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool

LONGEST = 32  # letters of the name of an extra attribute in a LAS file


@tool(
    "features.local",
    title="Features of points",
    tags=(
        "planarity",
        "linearity",
        "sphericity",
        "eigenvalue",
        "normal",
        "roughness",
        "curvature",
        "density",
        "geometric",
    ),
)
class FeaturesLocal:
    """Describe the neighbourhood of each point: a line, a plane or a cloud; steep, rough, dense.

    The neighbourhood is the point with its nearest `neighbours`, none of them as far as `radius`;
    or all within the radius, with `neighbours` none; or the nearest at any distance, with `radius`
    none, which needs the whole cloud at once. From the eigenvalues l1 >= l2 >= l3 of the covariance
    of its coordinates, and their shares e of the sum, come

    linearity (l1 - l2) / l1, planarity (l2 - l3) / l1, sphericity (scattering) l3 / l1,
    anisotropy (l1 - l3) / l1, omnivariance (e1 e2 e3)^(1/3), eigenentropy -sum of e ln e,
    surface_variation (change of curvature) l3 / (l1 + l2 + l3), and eigenvalue1 to eigenvalue3;

    from the plane through it roughness, the distance of the point from the plane, the normal
    nx, ny, nz, which points upwards, and verticality 1 - nz; and besides height_range,
    height_deviation, the number of neighbours with the point itself, and that number per volume
    and area of the sphere, volume_density and surface_density.

    Lengths are in the unit of the data; variances are in m2, densities per m3 and m2. A feature is
    not a number (NaN) where fewer than three points, or points at one position, have no shape, and
    those of the plane where points lie on a line. Ignored classes and withheld points are not
    taken as neighbours, and get NaN.
    """

    points: PointCloud = source("Points to describe")
    neighbours: int | None = param(
        "Number of nearest points that are neighbours; none for all within the radius",
        default=20,
        unit="1",
        ge=2,
        le=1000,
    )
    radius: float | None = param(
        "Neighbours are nearer than this; none for any distance",
        default=10.0,
        unit="m",
        gt=0,
        le=1000,
    )
    features: tuple[Name, ...] = param(
        "Names of the features to add",
        default=("linearity", "planarity", "sphericity", "verticality", "roughness"),
    )
    suffix: str = param(
        "Added to the name of each new attribute, to tell several radii apart",
        default="",
        label="Ending of new attributes",
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        described: PointCloud = sink(
            "The same points with an attribute for each feature", label="Points with features"
        )
        without_shape: int = sink("Points with a feature that is not a number", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """A neighbourhood has a limit, and a file can hold the names of the features."""
        if self.neighbours is None and self.radius is None:
            yield "radius", "give a radius, neighbours or both"
        if not self.features:
            yield "features", "give at least one name"
        for name in self.features:
            if len(name + self.suffix) > LONGEST:
                text = f"the name {name + self.suffix!r} has more than {LONGEST} letters"
                yield "suffix", text

    def halo(self) -> float:
        """The radius, beyond which there are no neighbours; infinite without one."""
        return math.inf if self.radius is None else self.radius

    def run(self, ctx: Context = QUIET) -> FeaturesLocal.Outputs:
        """Describe the points that take part."""
        cloud, metre = self.points, self.points.metre
        part = taking_part(cloud, self.ignore)
        found = covariance_features(
            cloud.xyz if part.all() else cloud.xyz[part],
            neighbours=self.neighbours,
            radius=self.radius,
            names=self.features,
            ctx=ctx,
        )
        added = {name: np.full(len(cloud), np.nan, np.float32) for name in found}
        for name, values in found.items():
            power = FEATURES[name].power
            added[name][part] = values if power in (0, 1) else values / metre**power
        return self._outputs(added, part)

    def _outputs(
        self, added: Mapping[Name, NDArray[np.float32]], part: NDArray[np.bool_]
    ) -> FeaturesLocal.Outputs:
        cloud, unknown = self.points, np.zeros(len(self.points), bool)
        for values in added.values():
            unknown |= np.isnan(values)
        count = int(np.count_nonzero(unknown & part & cloud.core))
        if count:
            log.info("%d of %d points lack neighbours, or a plane through them", count, len(cloud))
        length = f", {vertical_unit(cloud.crs)}" if cloud.crs else ""
        units = {0: "", 1: length, 2: ", m2", -2: ", 1/m2", -3: ", 1/m3"}
        return self.Outputs(
            described=cloud.with_attributes(
                {name + self.suffix: values for name, values in added.items()},
                descriptions={
                    name + self.suffix: FEATURES[name].text + units[FEATURES[name].power]
                    for name in added
                },
            ),
            without_shape=count,
        )
