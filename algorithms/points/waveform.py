"""The waveform of a pulse: what a scanner has recorded of the light that came back.

References
----------
ASPRS (2019). LAS specification 1.4, R15: "Waveform packet descriptor", point formats 4, 5, 9, 10.
Wagner, W. et al. (2006). Gaussian decomposition and calibration of a novel small-footprint
full-waveform digitising airborne laser scanner. ISPRS Journal 60, 100-112: what is seen in one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table
from toolbox.declare import Position, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

if TYPE_CHECKING:
    from toolbox.data.las.waveforms import Pulse

INDEX = "wavepacket_index"  # attribute of points: 0 without a waveform
PER_NS = 1000.0  # picoseconds


@tool(
    "points.waveform",
    title="Waveform of a pulse",
    tags=("waveform", "full-waveform", "pulse", "echo", "wdp", "plot"),
)
class PointsWaveform:
    """List and plot the waveform of the point nearest to a place: volts over time.

    Files of LAS 1.3 and 1.4 in point format 4, 5, 9 or 10 may hold, in themselves or in a file
    .wdp beside them, what the scanner has recorded of each pulse. Of the points that have such a
    packet, the one nearest to `place` is taken, seen from above; without it, the one nearest to
    the middle of these points. Of several as near as that, the one with the earliest packet.

    Each sample has its place in space: on the line of the pulse, which LAS states by a vector. In
    files that were looked at, it points to the sensor, although the specification can be read the
    other way. `distance` is counted from the point on, away from the sensor.

    A picture shows volts over time; the dashed line is at the sample nearest to the point.
    Compressed packets and those of other than 8, 16 or 32 bits a sample are an error.
    """

    points: PointCloud = source("Points with waveforms")
    place: Position | None = param(
        "Where to look for the point, in the CRS of the points; by default in their middle",
        default=None,
    )

    @outputs
    class Outputs:
        samples: Table = sink(
            "One row per sample: time in ns, volts, distance from the point in m, x, y, z, point",
            show=show.Curve(
                show.Axis("time", "time since the first sample", "ns"),
                (show.Axis("volts", "signal", "V", from_zero=False),),
                dashed="point",
            ),
        )
        sharing: int = sink("Points that share this waveform, which are returns of it", unit="1")

    def halo(self) -> float:
        """Infinite, as one point is chosen out of all."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PointsWaveform.Outputs:
        """Choose the point, and read its packet."""
        ctx.progress(0.0)
        cloud = self.points
        number = self._chosen()
        pulse = cloud.pulse(number)
        same = np.flatnonzero(cloud[INDEX] > 0)
        places = cloud["wavepacket_offset"]
        ctx.progress(1.0)
        return self.Outputs(
            samples=Table.from_rows(samples(pulse, cloud.xyz[number], cloud.metre)),
            sharing=int(np.count_nonzero(places[same] == places[number])),
        )

    def _chosen(self) -> int:
        """Number of the point with a waveform that is nearest to the place."""
        cloud = self.points
        having = np.flatnonzero(cloud[INDEX] > 0) if INDEX in cloud else np.zeros(0, np.intp)
        if not len(having):
            raise DataError(f"points: {cloud.name} has no points with a waveform")
        xy = cloud.xyz[having, :2]
        middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
        place = middle if self.place is None else np.array(self.place[:2])
        away = np.hypot(*(xy - place).T)
        order = np.lexsort((cloud.xyz[having, 2], cloud["wavepacket_offset"][having], away))
        return int(having[order[0]])


def samples(pulse: Pulse, point: Any, metre: float) -> Iterator[dict[str, Any]]:
    """Rows of the samples of a pulse.

    Parameters
    ----------
    pulse : the waveform
    point : x, y, z of its point
    metre : length of a metre in the unit of these
    """
    beyond = pulse.times - pulse.location  # picoseconds after the point
    speed = float(np.linalg.norm(pulse.vector)) / metre  # metres per picosecond, there and back
    places = np.asarray(point) - beyond[:, None] * pulse.vector
    nearest = int(np.argmin(np.abs(beyond)))
    for row, (time, volts) in enumerate(zip(pulse.times, pulse.volts, strict=True)):
        yield {
            "sample": row,
            "time": float(time) / PER_NS,
            "volts": float(volts),
            "distance": float(beyond[row]) * speed,
            **dict(zip("xyz", map(float, places[row]), strict=True)),
            "point": row == nearest,
        }
