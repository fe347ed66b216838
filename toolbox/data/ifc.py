"""Fronts of a building with their openings as IFC4, for programs of building information modelling.

A layer has the fronts and openings of an elevation, as `planes.openings` makes it: each in its own
coordinates, to the right and upwards, with the place of their origin and these directions in space
in attributes of the front. A front becomes an IfcWall, an opening in it an IfcOpeningElement that
is filled by an IfcDoor or IfcWindow with its width and height; sill and certainty are properties.
What an opening is stands in the layer alone: of another kind than door or window, such as
`door or window`, it is filled by an IfcBuildingElementProxy, whose object type is the kind.

How thick a wall is cannot be seen from outside: all have `THICKNESS`, and say that it is assumed.
The same layer makes the same file: identifiers are hashes of the layer and of what they name.

References
----------
ISO 16739-1:2018. Industry Foundation Classes (IFC4).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from toolbox import language
from toolbox.data.extras import IFC
from toolbox.data.ifc_entities import Entities
from toolbox.data.layer import day_of
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

SUFFIX = ".ifc"
THICKNESS = 0.3  # metres, of walls whose other side was not seen
LEAF = 0.05  # metres, of the doors and windows that fill an opening
WALL, UNSEEN = "facade", "unseen"
KINDS = {"door": "IfcDoor", "window": "IfcWindow"}  # others are proxies: nobody knows what they are
NEEDED = ("kind", "front_id", "opening_id", "width", "height", "sill")
PLACE = ("corner", "right", "up")  # of a front: attributes with _x, _y, _z


def write(
    frame: geopandas.GeoDataFrame,
    path: Path,
    metre: float,
    head: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write an elevation as IFC4.

    Parameters
    ----------
    metre : in the unit of the coordinates
    head : title, client and date (YYYY-MM-DD) of the set that it belongs to, if they are known

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
    entities = Entities(_name_of(frame, corners), head.get("title", ""), day_of(head))
    building = _Building(entities, origin, metre, head)
    for _, wall in walls.iterrows():
        own = frame[frame["front_id"] == wall["front_id"]]
        building.front(
            wall,
            own[~own["kind"].isin([WALL, UNSEEN])],
            float(own[own["kind"] == UNSEEN].area.sum()),
        )
    path.write_text(building.finished(), encoding="utf-8", newline="\n")


def _name_of(frame: geopandas.GeoDataFrame, corners: Any) -> str:
    """Tells this layer from all others, by its shapes and where they are."""
    hashed = hashlib.sha256(corners.tobytes())
    for shape in shapely.to_wkb(frame.geometry.to_numpy()):
        hashed.update(shape)
    return hashed.hexdigest()


class _Building:
    """A building of one storey, whose walls are fronts.

    Parameters
    ----------
    entities : of the file
    origin : place of the building in the coordinates of the data, in their unit
    metre : in that unit
    head : title and client
    """

    def __init__(
        self, entities: Entities, origin: Any, metre: float, head: Mapping[str, str]
    ) -> None:
        self.ifc, self.origin, self.metre = entities, origin, metre
        ifc = entities
        title = head.get("title", "")
        project = ifc.project(title or language.text("Survey of fronts"), client=head.get("client"))
        place = ifc.place((origin / metre).tolist())
        site = ifc.root("IfcSite", language.text("Site"), ObjectPlacement=place)
        inner = ifc.place((0, 0, 0), within=place)
        building = ifc.root(
            "IfcBuilding", title or language.text("Building"), ObjectPlacement=inner
        )
        storeys = language.text("All storeys")
        self.storey = ifc.root("IfcBuildingStorey", storeys, ObjectPlacement=inner)
        for whole, part in ((project, site), (site, building), (building, self.storey)):
            ifc.root("IfcRelAggregates", None, RelatingObject=whole, RelatedObjects=[part])
        self.contained: list[Any] = []

    def front(self, wall: pd.Series[Any], openings: geopandas.GeoDataFrame, unseen: float) -> None:
        """Add a wall, its openings, and what fills them; `unseen` is the area without points."""
        corner, right, up = (
            np.array([wall[f"{name}_{axis}"] for axis in "xyz"], float) for name in PLACE
        )
        place = self.ifc.place(
            (corner - self.origin) / self.metre,
            within=self.storey.ObjectPlacement,
            z=np.cross(right, up),  # outwards
            x=right,
        )
        whole = self._scaled(shapely.union_all([wall.geometry, *openings.geometry]))
        area, bare = whole.area, unseen / self.metre**2
        made = self.ifc.element(
            "IfcWall",
            language.told(f"Front {int(wall['front_id'])}"),
            place,
            self.ifc.body(whole, depth=THICKNESS),
            Description=language.for_people(
                f"{bare:.1f} of its {area:.1f} m2 were not seen; thickness assumed"
            ),
            PredefinedType="STANDARD",
        )
        facts = {"ThicknessIsAssumed": True, "Thickness": THICKNESS}
        if (spacing := _number(wall, "spacing")) is not None:
            facts["SpacingOfPoints"] = spacing / self.metre
        facts["AreaNotSeen"] = bare
        self.ifc.properties(made, "Survey_Wall", facts)
        self.contained.append(made)
        for _, one in openings.iterrows():
            self._opening(made, place, one)

    def _opening(self, wall: Any, place: Any, one: pd.Series[Any]) -> None:
        """Add a hole of the wall, and what fills it: a door, a window, or nobody knows which."""
        shape, number = self._scaled(one.geometry), int(one["opening_id"])
        facts, kind = self._facts(one), str(one["kind"])
        told = described(facts)
        inside = self.ifc.place((0, 0, 0), within=place)
        hole = self.ifc.element(
            "IfcOpeningElement",
            language.told(f"Opening {number}"),
            inside,
            self.ifc.body(shape, depth=THICKNESS),
            Description=told,
            PredefinedType="OPENING",
        )
        self.ifc.relation("IfcRelVoidsElement", BuildingElement=wall, OpeningElement=hole)
        known = {"OverallWidth": facts["Width"], "OverallHeight": facts["Height"]}
        fill = self.ifc.element(
            KINDS.get(kind, "IfcBuildingElementProxy"),
            language.capitalised(f"{language.text(kind)} {number}"),
            inside,
            self.ifc.body(shape, depth=LEAF, behind=facts["SetBack"]),
            Description=told,
            ObjectType=kind,
            Tag=str(number),
            **(known if kind in KINDS else {}),
        )
        self.ifc.relation("IfcRelFillsElement", OpeningElement=hole, BuildingElement=fill)
        self.ifc.properties(fill, "Survey_Opening", facts)
        self.contained.append(fill)

    def _facts(self, one: pd.Series[Any]) -> dict[str, Any]:
        """What is told of an opening, lengths in metres; it is set back within the wall."""
        names = {"Width": "width", "Height": "height", "Sill": "sill"}
        facts: dict[str, Any] = {"Kind": str(one["kind"])}
        facts |= {n: float(one[own]) / self.metre for n, own in names.items()}
        back = (_number(one, "set_back") or 0.0) / self.metre
        facts["SetBack"] = min(max(back, 0.0), THICKNESS - LEAF)
        if (sure := _number(one, "certainty")) is not None:
            facts["Certainty"] = sure
        for name, own in {"SidesUnsure": "unsure", "SidesNotSeen": "hidden"}.items():
            if isinstance(sides := one.get(own), str) and sides:
                facts[name] = sides
        return facts

    def finished(self) -> str:
        """The file, with all walls, doors and windows in the storey."""
        if self.contained:
            self.ifc.root(
                "IfcRelContainedInSpatialStructure",
                None,
                RelatedElements=self.contained,
                RelatingStructure=self.storey,
            )
        return self.ifc.text()

    def _scaled(self, shape: Any) -> Any:
        return shapely.transform(shape, lambda xy: xy / self.metre)


def described(facts: Mapping[str, Any]) -> str:
    """What an opening is, how certain that is, and which of its sides are unsure or not seen.

    In the language of the user.

    Examples
    --------
    >>> described({"Kind": "window", "Certainty": 0.98, "SidesNotSeen": "left"})
    'window, certainty 98 %; sides not seen, which may be elsewhere: left'
    >>> described({"Kind": "door", "SidesUnsure": "left, top"})
    'door; unsure sides: left, top'
    """
    told = [str(facts["Kind"])]
    if "Certainty" in facts:
        told.append(f", certainty {100 * facts['Certainty']:.0f} %")
    if "SidesUnsure" in facts:
        told.append(f"; unsure sides: {facts['SidesUnsure']}")
    if "SidesNotSeen" in facts:
        told.append(f"; sides not seen, which may be elsewhere: {facts['SidesNotSeen']}")
    return "".join(map(language.told, told))


def _number(row: pd.Series[Any], name: str) -> float | None:
    """An attribute that a layer need not have, if it is known."""
    value = row.get(name)
    return float(value) if value is not None and np.isfinite(value) else None
