"""Names the columns of results in words, and shows their numbers with the digits that they have."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsEditorWidgetSetup

LETTER, USUAL = 8, 100  # pixels of a letter of a heading, and of a column
UNITS = {"unit": "m", "unit²": "m²"}  # of columns in the unit of the data, where that is the metre
FAR = 1.7976931348623157e308


def name(layer: Any, columns: dict[str, Any]) -> None:
    """Give a layer the headings of its columns as aliases, and the digits of its numbers.

    What the file itself says of a column, as the style in a GeoPackage may, stays.

    Parameters
    ----------
    layer : of features or rows
    columns : heading, unit and digits by name, as the tool declares them
    """
    metres = is_in_metres(layer)
    table = layer.attributeTableConfig()
    table.update(layer.fields())
    for index, field in enumerate(layer.fields()):
        heading, unit, digits = columns.get(field.name(), ("", "", None))
        unit = (UNITS[unit] if metres else "") if unit in UNITS else unit
        if heading and not layer.attributeAlias(index):
            heading += f" [{unit}]" if unit else ""
            layer.setFieldAlias(index, heading)
            table.setColumnWidth(index, max(USUAL, LETTER * len(heading)))
        own = layer.editorWidgetSetup(index).type()
        if digits is not None and field.typeName() == "Real" and not own:
            how = {"Precision": digits, "AllowNull": True, "Style": "SpinBox"}
            how |= {"Min": -FAR, "Max": FAR, "Step": 10.0**-digits}
            layer.setEditorWidgetSetup(index, QgsEditorWidgetSetup("Range", how))
    layer.setAttributeTableConfig(table)


def is_in_metres(layer: Any) -> bool:
    """Whether the map and the heights of a layer are in metres; QGIS itself keeps the map alone."""
    try:
        from osgeo import ogr
    except ImportError:
        return False
    source = layer.source().split("|")[0]
    named = next((p[10:] for p in layer.source().split("|") if p.startswith("layername=")), "")
    file = ogr.Open(source)
    found = file and (file.GetLayerByName(named) if named else file.GetLayer(0))
    crs = found.GetSpatialRef() if found else None
    if crs is None or not crs.IsProjected() or crs.GetLinearUnits() != 1:
        return False
    return not crs.IsCompound() or crs.GetTargetLinearUnits("VERT_CS") == 1
