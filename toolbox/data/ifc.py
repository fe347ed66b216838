"""Fronts of a building with their openings as IFC4, for programs of building information modelling.

A layer has the fronts and openings of an elevation, as `planes.openings` makes it: each in its own
coordinates, to the right and upwards, with the place of their origin and these directions in space
in attributes of the front. A front becomes an IfcWall, an opening in it an IfcOpeningElement that
is filled by an IfcDoor or IfcWindow with its width and height; sill and certainty are properties.

How thick a wall is cannot be seen from outside: all have `THICKNESS`, and say that it is assumed.
The same layer makes the same file; identifiers are hashes of what they name.

References
----------
ISO 16739-1:2018. Industry Foundation Classes (IFC4).
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from toolbox import __version__
from toolbox.data.extras import IFC
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

SUFFIX = ".ifc"
THICKNESS = 0.3  # metres, of walls whose other side was not seen
LEAF = 0.05  # metres, of the doors and windows that fill an opening
WALL, DOOR = "facade", "door"
NEEDED = ("kind", "front_id", "opening_id", "width", "height", "sill")
PLACE = ("corner", "right", "up")  # of a front: attributes with _x, _y, _z
SPACE = uuid.UUID("6f0d3cf2-6a0e-4c5c-9c5b-8b6f8f0a5d11")  # of our identifiers
STAMP = "1980-01-01T00:00:00"  # of all files, so that the same layer is the same file


def write(frame: geopandas.GeoDataFrame, path: Path, metre: float) -> None:
    """Write an elevation as IFC4.

    Parameters
    ----------
    metre : in the unit of the coordinates

    Raises
    ------
    DataError
        The layer is no elevation, or ifcopenshell is not installed.
    """
    places = [f"{name}_{axis}" for name in PLACE for axis in "xyz"]
    if missing := [name for name in (*NEEDED, *places) if name not in frame.columns]:
        raise DataError(
            f"{path}: IFC holds fronts with openings, as the elevation of planes.openings; this "
            f"layer has no attribute {missing[0]}"
        )
    IFC.need()
    walls = frame[frame["kind"] == WALL]
    corners = walls[[f"corner_{axis}" for axis in "xyz"]].to_numpy(float)
    origin = np.floor(corners.min(axis=0)) if len(walls) else np.zeros(3)
    model = _Model(origin / metre)
    for _, wall in walls.iterrows():
        openings = frame[(frame["front_id"] == wall["front_id"]) & (frame["kind"] != WALL)]
        model.front(wall, openings, origin, metre)
    model.finish()
    path.write_text(model.file.to_string(), encoding="utf-8", newline="\n")


class _Model:
    """An IFC model with one building of one storey.

    Parameters
    ----------
    origin : place of the building in the coordinates of the data, metres
    """

    def __init__(self, origin: Any) -> None:
        import ifcopenshell

        self.file = ifcopenshell.file(schema="IFC4")
        header = self.file.header.file_name
        header.name, header.time_stamp = "", STAMP
        header.preprocessor_version = header.originating_system = f"lidar-toolbox {__version__}"
        self.number = 0
        self.contained: list[Any] = []
        world = self._axes((0, 0, 0))
        context = self._new(
            "IfcGeometricRepresentationContext",
            ContextType="Model",
            CoordinateSpaceDimension=3,
            Precision=1e-5,
            WorldCoordinateSystem=world,
        )
        self.body = self._new(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier="Body",
            ContextType="Model",
            ParentContext=context,
            TargetView="MODEL_VIEW",
        )
        units = [
            self._new("IfcSIUnit", UnitType=f"{kind}UNIT", Name=name)
            for kind, name in (
                ("LENGTH", "METRE"),
                ("AREA", "SQUARE_METRE"),
                ("VOLUME", "CUBIC_METRE"),
                ("PLANEANGLE", "RADIAN"),
            )
        ]
        project = self._root(
            "IfcProject",
            "Survey of fronts",
            RepresentationContexts=[context],
            UnitsInContext=self._new("IfcUnitAssignment", Units=units),
        )
        self.place = self._new(
            "IfcLocalPlacement", RelativePlacement=self._axes(tuple(origin.tolist()))
        )
        site = self._root("IfcSite", "Site", ObjectPlacement=self.place)
        inner = self._new("IfcLocalPlacement", PlacementRelTo=self.place, RelativePlacement=world)
        building = self._root("IfcBuilding", "Building", ObjectPlacement=inner)
        self.storey = self._root("IfcBuildingStorey", "All storeys", ObjectPlacement=inner)
        for whole, part in ((project, site), (site, building), (building, self.storey)):
            self._root("IfcRelAggregates", None, RelatingObject=whole, RelatedObjects=[part])

    def front(
        self, wall: pd.Series[Any], openings: geopandas.GeoDataFrame, origin: Any, metre: float
    ) -> None:
        """Add a wall, its openings, and what fills them."""
        corner, right, up = (
            np.array([wall[f"{name}_{axis}"] for axis in "xyz"], float) for name in PLACE
        )
        outwards = np.cross(right, up)
        axes = self._axes((corner - origin) / metre, outwards, right)
        place = self._new(
            "IfcLocalPlacement",
            PlacementRelTo=self.storey.ObjectPlacement,
            RelativePlacement=axes,
        )
        number = int(wall["front_id"])
        whole = shapely.union_all([wall.geometry, *openings.geometry])
        body = self._body(_scaled(whole, metre), depth=THICKNESS)
        made = self._element("IfcWall", f"Front {number}", place, body, PredefinedType="STANDARD")
        facts = {"ThicknessIsAssumed": True, "Thickness": THICKNESS}
        if "spacing" in wall and np.isfinite(wall["spacing"]):
            facts["SpacingOfPoints"] = float(wall["spacing"]) / metre
        self._properties(made, "Survey_Wall", facts)
        self.contained.append(made)
        for _, one in openings.iterrows():
            self._opening(made, place, one, metre)

    def _opening(self, wall: Any, place: Any, one: pd.Series[Any], metre: float) -> None:
        shape = _scaled(one.geometry, metre)
        number = int(one["opening_id"])
        inside = self._new(
            "IfcLocalPlacement", PlacementRelTo=place, RelativePlacement=self._axes((0, 0, 0))
        )
        hole = self._element(
            "IfcOpeningElement",
            f"Opening {number}",
            inside,
            self._body(shape, depth=THICKNESS),
            PredefinedType="OPENING",
        )
        self._root(
            "IfcRelVoidsElement", None, RelatingBuildingElement=wall, RelatedOpeningElement=hole
        )
        width, height, sill = (float(one[name]) / metre for name in ("width", "height", "sill"))
        back = one.get("set_back")
        depth = float(back) / metre if back is not None and np.isfinite(back) else 0.0
        depth = min(max(depth, 0.0), THICKNESS - LEAF)  # within the wall
        door = one["kind"] == DOOR
        fill = self._element(
            "IfcDoor" if door else "IfcWindow",
            f"{'Door' if door else 'Window'} {number}",
            inside,
            self._body(shape, depth=LEAF, behind=depth),
            OverallWidth=width,
            OverallHeight=height,
        )
        self._root(
            "IfcRelFillsElement", None, RelatingOpeningElement=hole, RelatedBuildingElement=fill
        )
        facts: dict[str, Any] = {"Width": width, "Height": height, "Sill": sill, "SetBack": depth}
        if (sure := one.get("certainty")) is not None and np.isfinite(sure):
            facts["Certainty"] = float(sure)
        if isinstance(hidden := one.get("hidden"), str) and hidden:
            facts["SidesNotSeen"] = hidden
        self._properties(fill, "Survey_Opening", facts)
        self.contained.append(fill)

    def finish(self) -> None:
        """Put all walls, doors and windows into the storey."""
        if self.contained:
            self._root(
                "IfcRelContainedInSpatialStructure",
                None,
                RelatedElements=self.contained,
                RelatingStructure=self.storey,
            )

    def _new(self, kind: str, *value: Any, **values: Any) -> Any:
        return self.file.create_entity(kind, *value, **values)

    def _root(self, kind: str, name: str | None, **values: Any) -> Any:
        """An entity with an identifier that follows from its kind and number."""
        from ifcopenshell import guid

        self.number += 1
        own = guid.compress(uuid.uuid5(SPACE, f"{kind} {self.number} {name}").hex)
        return self._new(kind, GlobalId=own, Name=name, **values)

    def _element(self, kind: str, name: str, place: Any, body: Any, **more: Any) -> Any:
        return self._root(kind, name, ObjectPlacement=place, Representation=body, **more)

    def _properties(self, element: Any, name: str, facts: Mapping[str, Any]) -> None:
        values = [
            self._new(
                "IfcPropertySingleValue",
                Name=key,
                NominalValue=self._new(_measure(key, value), value),
            )
            for key, value in facts.items()
        ]
        made = self._root("IfcPropertySet", name, HasProperties=values)
        self._root(
            "IfcRelDefinesByProperties",
            None,
            RelatedObjects=[element],
            RelatingPropertyDefinition=made,
        )

    def _axes(self, place: Sequence[float], z: Any = (0, 0, 1), x: Any = (1, 0, 0)) -> Any:
        point = self._new("IfcCartesianPoint", Coordinates=[float(v) for v in place])
        axis, along = (
            self._new("IfcDirection", DirectionRatios=[float(v) for v in way]) for way in (z, x)
        )
        return self._new("IfcAxis2Placement3D", Location=point, Axis=axis, RefDirection=along)

    def _body(self, shape: Any, *, depth: float, behind: float = 0.0) -> Any:
        """Outlines in the plane of the front, drawn out into the building by a depth."""
        items = [
            self._new(
                "IfcExtrudedAreaSolid",
                SweptArea=self._profile(part),
                Position=self._axes((0, 0, -behind)),
                ExtrudedDirection=self._new("IfcDirection", DirectionRatios=(0.0, 0.0, -1.0)),
                Depth=depth,
            )
            for part in _polygons(shape)
        ]
        shown = self._new(
            "IfcShapeRepresentation",
            ContextOfItems=self.body,
            RepresentationIdentifier="Body",
            RepresentationType="SweptSolid",
            Items=items,
        )
        return self._new("IfcProductDefinitionShape", Representations=[shown])

    def _profile(self, polygon: Any) -> Any:
        outer, *inner = (self._line(ring) for ring in (polygon.exterior, *polygon.interiors))
        if inner:
            return self._new(
                "IfcArbitraryProfileDefWithVoids",
                ProfileType="AREA",
                OuterCurve=outer,
                InnerCurves=inner,
            )
        return self._new("IfcArbitraryClosedProfileDef", ProfileType="AREA", OuterCurve=outer)

    def _line(self, ring: Any) -> Any:
        points = [
            self._new("IfcCartesianPoint", Coordinates=(float(x), float(y)))
            for x, y in shapely.get_coordinates(ring)[:-1]
        ]
        return self._new("IfcPolyline", Points=[*points, points[0]])


def _measure(name: str, value: Any) -> str:
    """The type of a property."""
    if isinstance(value, bool):
        return "IfcBoolean"
    if isinstance(value, str):
        return "IfcLabel"
    return "IfcReal" if name == "Certainty" else "IfcLengthMeasure"


def _scaled(shape: Any, metre: float) -> Any:
    return shapely.transform(shape, lambda xy: xy / metre)


def _polygons(shape: Any) -> Iterator[Any]:
    """The polygons of a shape, outer rings counterclockwise."""
    for part in shapely.get_parts(shapely.orient_polygons(shape)):
        if part.geom_type == "Polygon" and not part.is_empty:
            yield part
