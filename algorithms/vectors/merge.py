"""Layers of features joined to one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from toolbox.context import QUIET, Context
from toolbox.data import Vector
from toolbox.declare import outputs, param, sink, source, tool

if TYPE_CHECKING:
    import geopandas


@tool("vectors.merge", title="Merge features", tags=("merge", "join", "append", "combine", "union"))
class VectorsMerge:
    """Join the features of several layers to one, which knows the layer of each.

    That stands in the attribute `layer`: a drawing (.dxf) of it has a layer for each, and a .kmz a
    folder. Attributes that a layer does not have are empty in its features. All layers must be in
    one CRS.

    `label_attributes` names for each layer an attribute whose values are written beside its
    features, as points of a layer such as towers_labels with the attributes text and text_height,
    which a drawing shows as texts; an empty word for a layer without. What has a `severity` is in
    layers by that, such as objects_critical.
    """

    layers: tuple[Vector, ...] = source("Layers to join")
    layer_names: tuple[str, ...] | None = param(
        "Name of each layer, in their order; that of its file by default", default=None
    )

    label_attributes: tuple[str, ...] | None = param(
        "Attribute of each layer to write beside its features; an empty word for none",
        default=None,
        label="Attributes of labels",
    )
    label_height: float = param("Height of the labels", default=1.5, unit="m", gt=0, le=100)

    @outputs
    class Outputs:
        merged: Vector = sink("The features of all layers", also=(".city.json", ".ifc"))

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There is a name for each layer."""
        names, labels = self.layer_names, self.label_attributes
        if names is not None and len(names) != len(self.layers):
            yield "layer_names", f"must be {len(self.layers)}, one for each layer, got {len(names)}"

        if labels is not None and len(labels) != len(self.layers):
            yield "label_attributes", f"must be {len(self.layers)}, got {len(labels)}"
        for name, layer in zip(labels or (), self.layers, strict=False):
            if name and len(layer) and name not in layer.names:
                yield "label_attributes", f"{layer.name or 'a layer'} has no attribute {name!r}"

    def halo(self) -> float:
        """Zero, as each feature stays as it is."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> VectorsMerge.Outputs:
        """Join them."""
        import pandas as pd

        ctx.progress(0.0)
        frames = []
        for name, layer in zip(self._named(), self.layers, strict=True):
            frame = layer.frame
            if frame.geometry.name != "geometry":
                frame = frame.rename_geometry("geometry")
            frames.append(frame.drop(columns="layer", errors="ignore").assign(layer=name))
        wanted = self.label_attributes or ()
        for frame, attribute in zip(list(frames), wanted, strict=False):
            if attribute and len(frame):
                frames.append(labels_of(frame, attribute, self.label_height))
        filled = [frame for frame in frames if len(frame)] or frames[:1]
        joined = pd.concat(filled, ignore_index=True)
        return self.Outputs(merged=Vector(joined, name=self.layers[0].name))

    def _named(self) -> tuple[str, ...]:
        """The names of the layers: as given, else of their files, else their numbers."""
        given = [Path(layer.name).stem or str(k) for k, layer in enumerate(self.layers, start=1)]
        return self.layer_names or tuple(given)


def labels_of(
    frame: geopandas.GeoDataFrame, attribute: str, height: float
) -> geopandas.GeoDataFrame:
    """Points beside features with the text of an attribute, half a height to the right and above.

    Parameters
    ----------
    frame : features with an attribute `layer`
    height : of the texts, in the unit of the coordinates
    """
    import geopandas
    import shapely

    shapes = frame.geometry.to_numpy()
    kinds = shapely.get_dimensions(shapes)
    along = shapely.line_interpolate_point(np.where(kinds == 1, shapes, None), 0.5, normalized=True)
    middle = np.where(kinds == 2, shapely.point_on_surface(shapes), shapes)
    middle = np.where(kinds == 1, along, middle)
    known = ~(shapely.is_missing(middle) | shapely.is_empty(middle) | frame[attribute].isna())
    x, y, z = shapely.get_coordinates(middle[known], include_z=True).T
    values = frame.loc[known, attribute]
    made = {
        "layer": frame.loc[known, "layer"].astype(str).to_numpy() + "_labels",
        "text": [f"{value:g}" if isinstance(value, float) else str(value) for value in values],
        "text_height": height,
    }
    if "severity" in frame:  # a drawing switches them off with what they name
        made["severity"] = frame.loc[known, "severity"].to_numpy()
    places = np.column_stack([x + height, y + height, np.nan_to_num(z)])
    return geopandas.GeoDataFrame(made, geometry=shapely.points(places), crs=frame.crs)
