"""Algorithms of QGIS as tools, such as ``qgis:native:buffer``, which `qgis_process` runs.

QGIS itself describes the inputs and outputs of an algorithm. Parameters have the names of QGIS in
lower case; choices are the words that QGIS shows. Lengths are in the unit of the layer.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import math
import subprocess
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import psutil
from pyproj import CRS

from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.declare import kinds
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import CHOICE, Kind
from toolbox.declare.spec import NAME
from toolbox.declare.values import Extent, Position, Range
from toolbox.errors import DataError, ParameterError
from toolbox.qgis import process as qgis_process
from toolbox.runs.source import Source

PREFIX = "qgis:"
POLL = 0.05  # seconds
HIDDEN = 4  # flag of hidden parameters
NO_GEOMETRY, RASTERS, POINT_CLOUDS = 5, 3, 8  # source types of QGIS
INPUTS: Mapping[str, Any] = {
    "source": Vector,
    "vector": Vector,
    "raster": Raster,
    "pointcloud": PointCloud,
    "boolean": bool,
    "crs": CRS,
    "extent": Extent,
    "point": Position,
    "range": Range,
}
OUTPUTS: Mapping[str, Any] = {
    "outputVector": Vector,
    "outputRaster": Raster,
    "outputPointCloud": PointCloud,
    "outputNumber": float,
    "outputString": str,
    "outputBoolean": bool,
}
SUFFIXES: Mapping[Any, str] = {Vector: ".gpkg", Table: ".gpkg", Raster: ".tif", PointCloud: ".laz"}


@functools.cache
def load(id: str) -> Spec:
    """The specification of an algorithm.

    Raises
    ------
    ParameterError
        QGIS is not installed, or has no such algorithm.
    """
    algorithm = id.removeprefix(PREFIX)
    try:
        told = qgis_process.ask(["help", algorithm, "--json"])
    except DataError as err:
        raise ParameterError(f"{id}: {err}") from None
    says = told["algorithm_details"]
    inputs, outputs = _inputs(told), _outputs(told)
    about = {"algorithm": algorithm, "parameters": told["parameters"]}
    about["qgis_version"] = told["qgis_version"].partition("-")[0]  # without its name
    made: Any = type("QgisStep", (_QgisStep,), about)
    spec = Spec(id, says["name"], says["short_description"] or "", made, inputs, outputs)
    made.spec = spec
    return spec


def _inputs(told: Mapping[str, Any]) -> dict[str, Field]:
    found = {}
    for name, says in told["parameters"].items():
        raw = says["raw_definition"]
        if says["is_destination"] or raw["flags"] & HIDDEN or not NAME.fullmatch(name.lower()):
            continue
        found[name.lower()] = _input(name.lower(), says, raw)
    return found


def _input(name: str, says: Mapping[str, Any], raw: Mapping[str, Any]) -> Field:
    type, many = _type(says["type"]["id"], raw)
    kind = CHOICE if type is CHOICE else kinds.find(type)
    choices = tuple(map(str, raw["options"])) if kind is CHOICE else ()
    role: Any = "source" if kind.is_layer else "param"
    made = Field(name, kind, role, says["description"], None, None, {}, choices, many, True)
    default = _default(made, says["default_value"], raw)
    if default is not None:
        return dataclasses.replace(made, default=default, optional=bool(says["optional"]))
    if says["optional"]:
        return made
    return dataclasses.replace(made, default=dataclasses.MISSING, optional=False)


def _type(type: str, raw: Mapping[str, Any]) -> tuple[Any, bool]:
    """The type of a parameter here, text if there is no other, and whether it is a list."""
    if type == "enum":
        return CHOICE, bool(raw["allow_multiple"])
    if type == "multilayer":
        layers = {RASTERS: Raster, POINT_CLOUDS: PointCloud, NO_GEOMETRY: Table}
        return layers.get(raw["layer_type"], Vector), True
    if type == "source" and raw.get("data_types") == [NO_GEOMETRY]:
        return Table, False
    if "data_type" in raw and type not in ("field", "range"):
        return (int if raw["data_type"] == 0 else float), False
    return INPUTS.get(type, str), False


def _default(field: Field, value: Any, raw: Mapping[str, Any]) -> Any:
    """Convert the default of QGIS; None if there is none, or it has no meaning here."""
    if value is None or field.kind.is_layer:
        return None
    if field.kind is CHOICE and not raw["uses_static_strings"]:
        numbers = value if isinstance(value, list) else str(value).split(",")
        value = [field.choices[int(number)] for number in numbers if str(number) != ""]
        value = value if field.many else value[0]
    try:
        return field.parse(value)
    except (ValueError, TypeError):
        return None


def _outputs(told: Mapping[str, Any]) -> dict[str, Field]:
    found = {}
    for name, says in told["outputs"].items():
        type = OUTPUTS.get(says["type"])
        raw = told["parameters"].get(name, {}).get("raw_definition", {})
        if type is Vector and raw.get("data_type") == NO_GEOMETRY:
            type = Table
        if type is not None and NAME.fullmatch(name.lower()):
            kind = kinds.find(type)
            missing = dataclasses.MISSING
            found[name.lower()] = Field(
                name.lower(), kind, "sink", says["description"], missing, None, {}
            )
    return found


class _QgisStep:
    """An algorithm of QGIS with its values."""

    spec: ClassVar[Spec]
    algorithm: ClassVar[str]
    parameters: ClassVar[Mapping[str, Any]]
    qgis_version: ClassVar[str]

    def __init__(self, **values: Any) -> None:
        if problems := self.spec.problems(values):
            raise ParameterError(self.spec.id, problems)
        defaults = {n: f.default for n, f in self.spec.inputs.items() if not f.required}
        self.__dict__.update(defaults | values)

    def halo(self) -> float:
        """It is not known how far an algorithm of QGIS looks."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> SimpleNamespace:
        """Write the layers to files, run the algorithm, and read the results."""
        with tempfile.TemporaryDirectory(prefix="toolbox-qgis-") as folder:
            words = [*self._given(Path(folder), ctx.part(0, 0.2)), *self._written(Path(folder))]
            said = _run(["run", self.algorithm, "--json", "--", *words], ctx)
            results = json.loads(said[said.index("{") :])["results"]
            found = {}
            for name, field in self.spec.outputs.items():
                value = results.get(name.upper())
                if field.kind.is_layer and value is not None:
                    value = Source.of(field.kind, value).open(field.kind)
                found[name] = value
        ctx.progress(1.0)
        return SimpleNamespace(**found)

    def _given(self, folder: Path, ctx: Context) -> list[str]:
        words = []
        for name, field in self.spec.inputs.items():
            value = getattr(self, name)
            if value is None:
                continue
            raw = self.parameters[name.upper()]["raw_definition"]
            for number, item in enumerate(field.items(value)):
                path = folder / f"{name}_{number}"
                words.append(f"{name.upper()}={_text(field, item, raw, path, ctx)}")
        return words

    def _written(self, folder: Path) -> list[str]:
        """The path of each result, since QGIS deletes results without a path."""
        words = []
        for name, says in self.parameters.items():
            if says["is_destination"]:
                field = self.spec.outputs.get(name.lower())
                suffix = _suffix(field.kind) if field else ""
                words.append(f"{name}={folder / f'out_{name.lower()}'}{suffix}")
        return words


def _suffix(kind: Kind) -> str:
    return next((s for type, s in SUFFIXES.items() if kinds.find(type) is kind), "")


def _text(field: Field, value: Any, raw: Mapping[str, Any], path: Path, ctx: Context) -> str:
    """The text of a value for qgis_process; a layer is written to a file."""
    if field.kind.is_layer:
        path = path.with_suffix(_suffix(field.kind))
        value.save(path, ctx=ctx)
        return str(path)
    if field.kind is CHOICE and not raw["uses_static_strings"]:
        return str(field.choices.index(value))
    if isinstance(value, Extent):  # QGIS says both x first
        return f"{value.xmin!r},{value.xmax!r},{value.ymin!r},{value.ymax!r}"
    if isinstance(value, CRS):
        return str(value.to_string())
    return str(value).lower() if isinstance(value, bool) else str(value)


def _run(words: list[str], ctx: Context) -> str:
    """Run qgis_process and give what it prints; stop it if the run is cancelled."""
    program = qgis_process.find()
    if program is None:
        raise DataError(qgis_process.ABSENT)
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as out,
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as err,
    ):
        process = subprocess.Popen(
            [program, *words],
            env=qgis_process.environment(program),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,  # Ctrl-C is ours to pass on
            creationflags=qgis_process.NO_WINDOW,
        )
        try:
            while process.poll() is None:
                ctx.progress(0.2)
                time.sleep(POLL)
        finally:
            _end(process)
        out.seek(0)
        err.seek(0)
        if process.returncode:
            raise DataError(f"QGIS {words[1]}: {qgis_process.reason(err.read())}")
        return out.read()


def _end(process: subprocess.Popen[Any]) -> None:
    """Stop a program that still runs, and the programs that it has started, such as GDAL's."""
    if process.poll() is not None:
        return
    with contextlib.suppress(psutil.NoSuchProcess):
        started = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        for child in started:
            child.kill()
    process.wait()
