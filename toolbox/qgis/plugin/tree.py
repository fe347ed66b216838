"""Puts the layers of one run into a group of the layer tree, of which one raster is drawn."""

from __future__ import annotations

from bisect import bisect
from typing import Any


def arrange(stylers: list[Any], title: str) -> None:
    """Say where the layers of a run stand in the tree, and which of them are drawn at first.

    Rasters of one place hide each other, and points the raster below them. So the first raster that
    the tool declares is drawn, and what is no raster above it; what only checks the result is off.
    """
    rasters = [one for one in stylers if one.field["type"] == "raster"]
    shown = next((one for one in rasters if one.field["name"]), None)
    for one in rasters:
        one.hidden = one is not shown
    for one in stylers:
        one.hidden |= shown is not None and one.field["type"] == "pointcloud"
    group = Group(title) if len(stylers) > 1 else None
    for rank, one in enumerate(sorted(stylers, key=lambda one: one.field["type"] == "raster")):
        one.group, one.rank = group, rank


class Group:
    """A group on top of the tree, which is made when its first layer is there."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.made: Any = None
        self.ranks: list[int] = []

    def take(self, node: Any, rank: int, root: Any) -> Any:
        """Move the node of a layer into this group, and give the new one.

        QGIS loads layers in the order of their paths, and puts them beside the layer that is chosen
        in the tree, so also into the group of an earlier run.
        """
        if self.made is None:
            self.made = _parent(root).insertGroup(0, self.title)
        position = bisect(self.ranks, rank)
        self.ranks.insert(position, rank)
        moved, there = node.clone(), self.made.children()
        more = node in there and there.index(node) < position  # QGIS has put it in here itself
        self.made.insertChildNode(position + more, moved)  # first: without a node it would be gone
        node.parent().removeChildNode(node)
        return moved


def _parent(root: Any) -> Any:
    """The group that the options of Processing name for all results, or the whole tree."""
    try:
        from processing.core.ProcessingConfig import ProcessingConfig
    except ImportError:  # QGIS without its Processing plugin has no such option
        return root
    name = ProcessingConfig.getSetting(ProcessingConfig.RESULTS_GROUP_NAME)
    return (root.findGroup(name) if name else None) or root
