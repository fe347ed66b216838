"""The entities of an IFC4 file: identifiers, places, bodies, properties; lengths are metres."""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import shapely

from toolbox import __version__, language

SPACE = uuid.UUID("6f0d3cf2-6a0e-4c5c-9c5b-8b6f8f0a5d11")  # of our identifiers
MIDNIGHT = "T00:00:00"  # a file is of a day, so that the same layer is the same file
NO_DAY = "1980-01-01"  # of files whose day is not told
UNITS = {
    "LENGTH": "METRE",
    "AREA": "SQUARE_METRE",
    "VOLUME": "CUBIC_METRE",
    "PLANEANGLE": "RADIAN",
}


class Entities:
    """Makes the entities of one file.

    Parameters
    ----------
    name : of the data; files of other data have other identifiers
    title : what the file is called within
    day : YYYY-MM-DD; "" if it is not known
    """

    def __init__(self, name: str, title: str = "", day: str = "") -> None:
        import ifcopenshell

        self._file = ifcopenshell.file(schema="IFC4")
        header = self._file.header.file_name
        header.name, header.time_stamp = title, (day or NO_DAY) + MIDNIGHT
        header.preprocessor_version = header.originating_system = f"lidar-toolbox {__version__}"
        self._space = uuid.uuid5(SPACE, name)
        self._count = 0
        self._context = self._new(
            "IfcGeometricRepresentationContext",
            ContextType="Model",
            CoordinateSpaceDimension=3,
            Precision=1e-5,
            WorldCoordinateSystem=self._axes((0, 0, 0)),
        )
        self._shown = self._new(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier="Body",
            ContextType="Model",
            ParentContext=self._context,
            TargetView="MODEL_VIEW",
        )

    def text(self) -> str:
        """The file."""
        return str(self._file.to_string())

    def project(self, name: str, client: str | None = None) -> Any:
        """The project, to which all belongs, with its units, and for whom it is."""
        units = [self._new("IfcSIUnit", UnitType=f"{k}UNIT", Name=n) for k, n in UNITS.items()]
        return self.root(
            "IfcProject",
            name,
            Description=language.text("For {client}").replace("{client}", client)
            if client
            else None,
            RepresentationContexts=[self._context],
            UnitsInContext=self._new("IfcUnitAssignment", Units=units),
        )

    def root(self, kind: str, name: str | None, **values: Any) -> Any:
        """An entity with an identifier that follows from the data, its kind, number and name."""
        from ifcopenshell import guid

        self._count += 1
        own = guid.compress(uuid.uuid5(self._space, f"{kind} {self._count} {name}").hex)
        return self._new(kind, GlobalId=own, Name=name, **values)

    def element(self, kind: str, name: str, place: Any, body: Any, **more: Any) -> Any:
        """Something built, with a place and a body."""
        return self.root(kind, name, ObjectPlacement=place, Representation=body, **more)

    def relation(self, kind: str, **elements: Any) -> Any:
        """A relation from the first of two elements to the second, by their roles."""
        relating, related = elements.items()
        ends = {f"Relating{relating[0]}": relating[1], f"Related{related[0]}": related[1]}
        return self.root(kind, None, **ends)

    def properties(self, element: Any, name: str, facts: Mapping[str, Any]) -> None:
        """Give an element a set of properties."""
        values = [
            self._new(
                "IfcPropertySingleValue",
                Name=key,
                NominalValue=self._new(_measure(key, value), value),
            )
            for key, value in facts.items()
        ]
        made = self.root("IfcPropertySet", name, HasProperties=values)
        self.root(
            "IfcRelDefinesByProperties",
            None,
            RelatedObjects=[element],
            RelatingPropertyDefinition=made,
        )

    def place(
        self,
        point: Iterable[float],
        *,
        within: Any = None,
        z: Iterable[float] = (0, 0, 1),
        x: Iterable[float] = (1, 0, 0),
    ) -> Any:
        """Axes at a point, in those of another place or in those of the world."""
        axes = self._axes(point, z, x)
        return self._new("IfcLocalPlacement", PlacementRelTo=within, RelativePlacement=axes)

    def body(self, shape: Any, *, depth: float, behind: float = 0.0) -> Any:
        """Polygons in the plane of x and y, drawn out against z by a depth.

        Parameters
        ----------
        behind : how far behind the plane the body begins
        """
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
            ContextOfItems=self._shown,
            RepresentationIdentifier="Body",
            RepresentationType="SweptSolid",
            Items=items,
        )
        return self._new("IfcProductDefinitionShape", Representations=[shown])

    def _new(self, kind: str, *value: Any, **values: Any) -> Any:
        return self._file.create_entity(kind, *value, **values)

    def _axes(
        self, point: Iterable[float], z: Iterable[float] = (0, 0, 1), x: Iterable[float] = (1, 0, 0)
    ) -> Any:
        origin = self._new("IfcCartesianPoint", Coordinates=[float(v) for v in point])
        axis, along = (
            self._new("IfcDirection", DirectionRatios=[float(v) for v in way]) for way in (z, x)
        )
        return self._new("IfcAxis2Placement3D", Location=origin, Axis=axis, RefDirection=along)

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
    if name.startswith("Area"):
        return "IfcAreaMeasure"
    return "IfcReal" if name == "Certainty" else "IfcLengthMeasure"


def _polygons(shape: Any) -> Iterator[Any]:
    """The polygons of a shape, outer rings counterclockwise."""
    for part in shapely.get_parts(shapely.orient_polygons(shape)):
        if part.geom_type == "Polygon" and not part.is_empty:
            yield part
