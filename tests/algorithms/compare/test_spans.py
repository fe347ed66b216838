"""Wires in full, in part, missed and invented."""

from __future__ import annotations

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from algorithms.compare.spans import CompareSpans
from toolbox.data import Vector
from toolbox.errors import DataError


def layer(*lines: tuple[float, float, float, float], crs: int = 32635) -> Vector:
    """Wires along x: from, to, y and lift; each hangs between 10 m high ends 100 m apart."""
    shapes = []
    for start, end, y, lift in lines:
        x = np.linspace(start, end, 60)
        z = 10 + lift + ((x % 100) - 50) ** 2 / 800
        shapes.append(shapely.LineString(np.column_stack([x, np.full(60, y), z])))
    frame = geopandas.GeoDataFrame(
        {"span_id": [int(line[0] // 100) for line in lines]}, geometry=shapes, crs=CRS(crs)
    )
    return Vector(frame)


TRUTH = layer((0, 99, 0, 0), (0, 99, 3, 0), (100, 199, 0, 0), (100, 199, 3, 0), (200, 299, 0, 0))


def test_all_found() -> None:
    result = CompareSpans(wires=TRUTH, reference=TRUTH).run()
    assert (result.in_full, result.in_part, result.missed, result.invented) == (3, 0, 0, 0)
    assert result.height_rms == pytest.approx(0)


def test_part_missed_and_invented() -> None:
    wires = layer(
        (0, 99, 0, 0.1),
        (0, 99, 3, 0.1),
        (100, 140, 0, 0.1),
        (100, 199, 3, 0.1),
        (200, 299, 9, 0),
        (0, 99, 3, 5),
    )
    result = CompareSpans(wires=wires, reference=TRUTH).run()
    assert (result.in_full, result.in_part, result.missed, result.invented) == (1, 1, 1, 2)
    assert result.height_rms == pytest.approx(0.1, abs=1e-3)
    rows = result.table.frame
    assert rows.found.tolist() == [
        "in full",
        "in full",
        "in part",
        "in full",
        "missed",
        "invented",
        "invented",
    ]
    assert rows.share.iloc[2] == pytest.approx(0.41, abs=0.02)
    assert rows.bias.iloc[0] == pytest.approx(0.1, abs=1e-3)


def test_a_wire_across_two_spans_is_neither_in_full() -> None:
    result = CompareSpans(wires=layer((0, 199, 0, 0)), reference=layer((0, 99, 0, 0))).run()
    assert (result.in_full, result.in_part, result.invented) == (0, 1, 1)


def test_nothing_found() -> None:
    empty = Vector(TRUTH.frame.iloc[:0])
    result = CompareSpans(wires=empty, reference=TRUTH).run()
    assert (result.missed, result.invented, result.height_rms) == (3, 0, None)


def test_bad_layers_and_columns_are_named() -> None:
    flat = geopandas.GeoDataFrame(geometry=[shapely.Point(0, 0)], crs=CRS(32635))
    with pytest.raises(DataError, match="wires: must be lines"):
        CompareSpans(wires=Vector(flat), reference=TRUTH)
    with pytest.raises(DataError, match="span: no column 'span'; there are span_id"):
        CompareSpans(wires=TRUTH, reference=TRUTH, span="span")


def test_one_wire_of_a_bundle_does_not_count_for_two() -> None:
    bundle = layer((0, 99, 0, 0), (0, 99, 0.4, 0))
    result = CompareSpans(wires=layer((0, 99, 0.38, 0)), reference=bundle).run()
    assert (result.in_full, result.in_part, result.invented) == (0, 1, 0)
    assert result.table.frame.found.tolist() == ["in part", "in full"]
    both = CompareSpans(wires=layer((0, 99, 0.39, 0), (0, 99, 0.02, 0)), reference=bundle).run()
    assert (both.in_full, both.doubled) == (1, 0)
    assert both.table.frame.wire.tolist() == [1, 0]
    part = CompareSpans(wires=layer((0, 99, 0, 0), (0, 60, 0.4, 0)), reference=bundle).run()
    assert (part.in_part, part.doubled, part.invented) == (1, 0, 0)


def test_a_wire_found_twice_is_told_but_pieces_are_not() -> None:
    one = layer((0, 99, 0, 0))
    twice = CompareSpans(wires=layer((0, 99, 0, 0), (0, 99, 0.1, 0)), reference=one).run()
    assert (twice.in_full, twice.invented, twice.doubled) == (1, 0, 1)
    assert twice.table.frame.wire.tolist() == [0, 1]
    pieces = CompareSpans(wires=layer((0, 48, 0, 0), (52, 99, 0, 0)), reference=one).run()
    assert (pieces.in_full, pieces.in_part, pieces.doubled) == (0, 1, 0)


def test_features_without_geometry_are_named() -> None:
    nothing = Vector(TRUTH.frame.set_geometry([None] * len(TRUTH)))
    with pytest.raises(DataError, match="wires: must hold lines"):
        CompareSpans(wires=nothing, reference=TRUTH)


def test_lines_without_a_span_are_no_wires(caplog: pytest.LogCaptureFixture) -> None:
    frame = TRUTH.frame.astype({"span_id": float})
    frame.loc[0, "span_id"] = np.nan
    result = CompareSpans(wires=TRUTH, reference=Vector(frame)).run()
    assert (result.in_full, result.in_part, result.missed, result.invented) == (3, 0, 0, 1)
    assert "1 lines of the reference have no span_id: left out" in caplog.text
