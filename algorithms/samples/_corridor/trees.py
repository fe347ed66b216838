"""Trees near wires: how near, and as features."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from algorithms.samples._corridor.catenary import placed
from algorithms.samples._survey import Features, Floats, Records, Terrain, crown_widths

NEAR = 10.0  # trees nearer to a wire than this carry their clearance


class Hanging(Protocol):
    """What hangs in the air and may be drawn as points."""

    def points(self, step: float) -> Floats:
        """Positions along it at about `step` metres, array of shape (n, 3)."""


def tree_features(terrain: Terrain, spans: Sequence[Hanging], crowns: Records) -> Features:
    """Features of trees: vertical lines, with the distance from crown to wire where it is short."""
    ground = terrain.at(crowns["x"], crowns["y"])
    clearances = _clearances(spans, crowns)
    features: Features = []
    for crown, z, clearance in zip(crowns, ground, clearances, strict=True):
        foot, top = np.array([(crown["x"], crown["y"], h) for h in (z, crown["top"])])
        properties = {
            "kind": "shrub" if crown["base"] < z else "tree",
            "object_id": int(crown["object_id"]),
            "height": round(float(crown["top"] - z), 3),
            "crown_radius": round(float(crown["radius"]), 3),
        }
        if clearance < NEAR:
            properties["clearance"] = round(float(clearance), 2)
        features.append((placed(np.array([foot, top])), properties))
    return features


def _clearances(spans: Sequence[Hanging], crowns: Records) -> Floats:
    """Distance of each crown's surface from the nearest wire; inf where it is clearly far."""
    clearances = np.full(len(crowns), np.inf)
    if not spans or not len(crowns):
        return clearances
    wires = cKDTree(np.concatenate([span.points(0.1) for span in spans]))
    middle = (crowns["base"] + crowns["top"]) / 2
    away = wires.query(np.column_stack([crowns["x"], crowns["y"], middle]))[0]
    size = np.hypot((crowns["top"] - crowns["base"]) / 2, crowns["radius"])
    for i in np.flatnonzero(away < size + NEAR):
        clearances[i] = np.min(wires.query(_hull(crowns[i]))[0])
    return clearances


def _hull(crown: np.void) -> Floats:
    """Points on the surface of a crown."""
    t, turn = np.linspace(0, 1, 21), np.linspace(0, 2 * np.pi, 25)[:-1, None]
    radius = crown["radius"] * crown_widths(int(crown["shape"]), t)
    x, y = crown["x"] + radius * np.cos(turn), crown["y"] + radius * np.sin(turn)
    z = np.broadcast_to(crown["base"] + t * (crown["top"] - crown["base"]), x.shape)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)
