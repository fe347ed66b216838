"""Classes of a town beside ground and buildings: water, low to high vegetation, and the rest.

How well it does: docs/explanation/urban-classes.md.

References
----------
Demir, N. and Acar, U.: ground, then buildings, then vegetation.
LAS 1.4 R15 (ASPRS 2019), table 17: the classes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.classify import _evidence
from algorithms.classify._density import Lengths
from algorithms.classify._evidence import FOOT, solid
from algorithms.classify._heights import by_height
from algorithms.classify._vehicles import vehicles
from algorithms.shared import parameters
from algorithms.shared.ground import among, taking_part
from algorithms.shared.parameters import NAMED_STRUCTURES, SURFACES
from algorithms.shared.polygons import Polygons, polygons
from algorithms.shared.selection import of_classes
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.data.crs import crs_conflict
from toolbox.declare import ClassList, Share, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

GROUND, BUILDING, WATER, REST = (np.uint8(k) for k in (2, 6, 9, 1))

Mask = NDArray[np.bool_]


@tool(
    "classify.urban",
    title="Classify the rest of a town",
    tags=(
        "urban",
        "vegetation",
        "water",
        "building",
        "town",
    ),
)
class ClassifyUrban:
    """Classify water, vegetation and the rest where ground and buildings are known.

    Ground (2) and buildings (6) stay; run ground.classify and classify.buildings first, or
    models.urban_classes, which does all. Of the others, and of the ground, what lies in polygons of
    `water` and not half a metre above the ground becomes water (9), except for bodies whose
    attribute evidence is level alone, which in a town may be squares. Of what is left, points
    around which at least `planarity` of the points lie on planes, and less than twice that share
    lets the pulse through, are walls and the like: class 1. So are low oblongs of the size of cars
    and other vehicles that stand free and let few pulses through. All else is low (3), medium (4)
    or high vegetation (5) by its height above the ground, whose limits are `low` and `high`.

    Wires, poles and rough objects become vegetation. With `penetration` only that does which lets
    pulses through for certain; what cannot be told from a crane or a mast stays class 1, and where
    no pulse has several returns, that is all. The attribute confidence says from 0 to 1 how
    clear the evidence is between vegetation and what is built, and is 1 for ground and water.
    Points that take no part keep the one they have, if they have one. Heights are
    HeightAboveGround if points have it.
    """

    points: PointCloud = source("Points with classified ground and buildings")
    water: Vector | None = source(
        "Polygons of water, as of shoreline.extract", default=None, shapes="polygon"
    )
    low: float = parameters.low_ends()
    high: float = parameters.high_begins()
    planarity: float = parameters.planarity()
    penetration: float = param(
        "Least share of returns around vegetation that let the pulse through",
        default=0.0,
        unit="1",
        ge=0,
        le=1,
        label="Share of pulses that go through",
    )
    flat: float | None = parameters.flat_by_noise()
    radius: float | None = parameters.radius_by_density()
    context: float | None = parameters.context_by_density()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes 1 to 6 and 9, noise (7, 18), classes that stay; and "
            "confidence",
            label="Classified points",
        )
        ground_share: float = parameters.ground_share()
        vegetation_share: float = sink("Share of points that are vegetation", unit="1")
        building_share: float = sink("Share of points that are building", unit="1")
        water_share: float = sink("Share of points that are water", unit="1")
        rest_share: float = sink("Share of points that are none of the known classes", unit="1")

        def in_words(self) -> str:
            """Shares of what there is."""
            return (
                f"Of the points, in the end, {100 * self.ground_share:.1f} % are ground, "
                f"{100 * self.vegetation_share:.1f} % vegetation, "
                f"{100 * self.building_share:.1f} % buildings, {100 * self.water_share:.1f} % "
                f"water and {100 * self.rest_share:.1f} % none of the known classes; what lies in "
                "water and was taken for ground at first is water."
            )

    def check(self) -> Iterator[tuple[str, str]]:
        """The height limits are in order."""
        if self.low > self.high:
            yield "low", f"must be <= high ({self.high:g}), got {self.low:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have a classification, and the water has their CRS."""
        name = self.points.name or "the cloud"
        if "classification" not in self.points:
            yield "points", f"{name} has no classification; classify ground first"
        if self.water is not None and (
            text := crs_conflict(self.water.crs, self.points.crs, heights=False)
        ):
            yield "water", f"{self.water.name or 'the layer'} {text} of {name}"

    def halo(self) -> float:
        """Reach of the terrain and of the neighbourhoods of the features."""
        return _evidence.HALO

    def run(self, ctx: Context = QUIET) -> ClassifyUrban.Outputs:
        """Classify the points that are neither ground nor building."""
        cloud = self.points
        part = taking_part(cloud, self.ignore, among(self.keep_classes, NAMED_STRUCTURES))
        chosen = cloud if part.all() else cloud.select(part)
        classes = np.array(cloud["classification"], np.uint8)
        confidence = np.zeros(len(cloud), np.float32)
        if "confidence" in cloud:
            confidence[:] = cloud["confidence"]
        if not len(cloud):
            return self._packed(classes, confidence)
        bare = ClassList([int(GROUND), *among(self.keep_classes, SURFACES)])
        if not of_classes(chosen["classification"], bare).any():
            raise NothingToDo(
                f"points: none is of class {bare}; classify ground first",
                instead=self._packed(classes, confidence),
            )
        lengths = Lengths.of(cloud, self.flat, self.radius, self.context, ctx=ctx)
        features = _evidence.PointFeatures(
            chosen,
            lengths.radius,
            lengths.context,
            ctx.part(0.0, 0.9),
            flat=lengths.flat,
            by_noise=lengths.by_noise,
            ground_classes=bare,
        )
        features.warn_without_returns(self._without_returns)
        classes[part] = self._judged(features, lengths.spacing, ctx.part(0.9, 1.0))
        told = of_classes(classes[part], (*bare, int(WATER)))
        confidence[part] = np.where(told, 1.0, clear(features))
        ctx.progress(1.0)
        return self._packed(classes, confidence)

    @property
    def _without_returns(self) -> str:
        if self.penetration > 0:
            return "vegetation that the file does not name cannot be told, and stays class 1"
        return "dense crowns may be taken for objects"

    def _judged(
        self, features: _evidence.PointFeatures, spacing: float, ctx: Context
    ) -> NDArray[np.uint8]:
        """Class of each point."""
        cloud, (ground, height) = features.cloud, features.terrain
        classes = np.array(cloud["classification"], np.uint8)
        built = classes == BUILDING
        low = ~built & (ground | (height < FOOT))
        wet = np.zeros(len(cloud), bool)
        if self.water is not None:
            wet[low] = Polygons.of(polygons(sure(self.water), "water")).hold(cloud.xyz[low])
        free = ~of_classes(classes, self.keep_classes or ())
        left = free & ~ground & ~built & ~wet
        plant = ~(solid(features) & (features.around["planarity"] >= self.planarity))
        plant &= features.around["returns"] >= self.penetration
        plant &= ~vehicles(features, left, spacing, ctx)
        kinds = by_height(height * cloud.metre, self.low, self.high)
        classes[left] = np.where(plant & np.isfinite(height), kinds, REST)[left]
        classes[wet & free] = WATER
        return classes

    def _packed(
        self, classes: NDArray[np.uint8], confidence: NDArray[np.float32]
    ) -> ClassifyUrban.Outputs:
        core = self.points.core

        def share(*kinds: int) -> Share:
            return Share.of_points(of_classes(classes, kinds), core)

        return self.Outputs(
            classified=self.points.with_attributes(
                {"classification": classes, "confidence": confidence},
                descriptions={"confidence": "0 doubtful to 1 clear"},
            ),
            ground_share=share(int(GROUND)),
            vegetation_share=share(3, 4, 5),
            building_share=share(int(BUILDING)),
            water_share=share(int(WATER)),
            rest_share=share(int(REST)),
        )


def sure(water: Vector) -> Vector:
    """The layer of water without bodies whose only evidence is their level."""
    frame = water.frame
    if "evidence" not in frame:
        return water
    doubtful = frame["evidence"] == "level"
    if doubtful.any():
        log.info("%d bodies of water are known by their level alone: left out", doubtful.sum())
    return Vector(frame[~doubtful], name=water.name, geometry_type=water.geometry_type)


def clear(features: _evidence.PointFeatures) -> NDArray[np.float64]:
    """Contrast between the evidence for vegetation and for buildings, 0 to 1, shape (n,)."""
    flat = features.around["planarity"] / _evidence.ON_PLANES
    torn = features.around["returns"] / _evidence.LET_THROUGH
    total = flat + torn
    return np.asarray(np.abs(flat - torn) / np.where(total > 0, total, 1.0))
