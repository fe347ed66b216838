"""Run a tool by its id: paths in, layers or paths out."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox import catalog, files
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Raster, Vector
from toolbox.data.crs import describe_crs, parse_crs, same_crs
from toolbox.errors import DataError, ParameterError
from toolbox.fields import Field, Spec
from toolbox.kinds import parsed_options
from toolbox.picture import draw

FULL = 2**20  # bytes; with less than this left a disk counts as full
READ, WRITE = 0.15, 0.85  # shares of the progress at which reading ends and writing begins


def run(
    id: str,
    values: Mapping[str, Any],
    *,
    overwrite: bool = False,
    assume_crs: str | CRS | None = None,
    picture: str | Path | None = None,
    ctx: Context = QUIET,
) -> dict[str, Any]:
    """Run a tool on files or layers.

    Parameters
    ----------
    id : such as "ground.csf"
    values : inputs by name, and for each output that should be written its path. A source is a
        layer, a path, or a mapping of a path and how to open it, for example
        ``{"path": "a.txt", "columns": ["x", "y", "z", "label"]}``; an output may likewise be
        ``{"path": "a.tif", "cog": True}``. Texts are read as on the command line.
    overwrite : whether outputs may replace files
    assume_crs : CRS of sources that state none; "local" for plain metres
    picture : PNG to draw the resulting layers into
    ctx : where progress goes, and what can cancel the run

    Returns
    -------
    dict
        By output name: the path where one was given, else the layer, number or text.

    Raises
    ------
    ParameterError
        Wrong names, values or paths: all of them in one error.
    DataError
        A source cannot be read, or holds what the tool cannot use.
    Cancelled
        `ctx` asked the run to stop; nothing was written.
    """
    spec = catalog.load(id)
    given = {name: value for name, value in values.items() if name not in spec.outputs}
    wanted = {n: v for n, v in values.items() if n in spec.outputs and v is not None}
    if picture is not None:
        wanted["picture"] = picture
    sources = {name: value for name, value in given.items() if name in spec.sources}
    targets = {name: Target.of(name, value, spec) for name, value in wanted.items()}
    settings = _checked(spec, given, targets, overwrite=overwrite)
    layers = _opened(spec, sources, _crs(assume_crs, id), ctx.part(0, READ))
    result = spec.build(settings | layers).run(ctx.part(READ, WRITE))
    found = {name: getattr(result, name) for name in spec.outputs}
    written = _write(spec, found, targets, overwrite, ctx.part(WRITE, 1))
    return found | written


@dataclass(frozen=True)
class Target:
    """Where and how an output is to be written.

    Attributes
    ----------
    path : as it was given; None if the value does not name one
    home : the file to write: of a link, the one behind it
    suffixes : endings that the output can have; none for a number, which is printed
    """

    path: Path | None
    home: Path | None
    options: Mapping[str, Any]
    suffixes: tuple[str, ...]
    known: tuple[str, ...]
    parts: files.Parts

    @classmethod
    def of(cls, name: str, value: Any, spec: Spec) -> Target:
        """Take a path, or a mapping of a path and options, apart."""
        how = dict(value) if isinstance(value, Mapping) else {"path": value}
        path = how.pop("path", None)
        place = Path(path) if isinstance(path, str | Path) and str(path) else None
        home = _resolved(place) if place else None
        if name == "picture":
            return cls(place, home, how, (".png",), (), lambda path: (path,))
        kind = spec.outputs[name].kind
        return cls(place, home, how, kind.suffixes, kind.save_options, kind.parts)

    def problem(self) -> str | None:
        """What is wrong with it, apart from the place."""
        if not self.suffixes:
            return "is a value, which is printed; it cannot be written to a file"
        if self.home is None:
            return "must be a path" if self.path is None else f"{self.path} is no usable path"
        try:
            parsed_options(self.options, self.known)
        except ValueError as err:
            return str(err)
        return None


def _resolved(path: Path) -> Path | None:
    """The file behind links; None for links in a circle and names that no file can have."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        return None


def _crs(crs: str | CRS | None, where: str) -> CRS | None:
    if crs is None or isinstance(crs, CRS):
        return crs
    try:
        return parse_crs(str(crs))
    except ValueError as err:
        raise ParameterError(where, {"assume_crs": str(err)}) from None


def _checked(
    spec: Spec, given: Mapping[str, Any], targets: Mapping[str, Target], *, overwrite: bool
) -> dict[str, Any]:
    """The values that are no layers. What can be checked without data is checked here."""
    sources = {name: value for name, value in given.items() if name in spec.sources}
    settings = {name: value for name, value in given.items() if name not in spec.sources}
    values, problems = spec.parse(settings, present=sources)
    if not problems:
        problems = spec.rules(values)
    for name, value in sources.items():
        if text := _source_problem(spec.sources[name], value):
            problems[name] = text
    problems |= _target_problems(targets, sources, overwrite=overwrite)
    if problems:
        raise ParameterError(spec.id, dict(sorted(problems.items())))
    return values


def _paths(value: Any) -> list[Path]:
    """The files that the raw value of a source names."""
    items = value if isinstance(value, list | tuple) else [value]
    named = [item.get("path") if isinstance(item, Mapping) else item for item in items]
    return [Path(path) for path in named if isinstance(path, str | Path)]


def _source_problem(field: Field, value: Any) -> str | None:
    """What is wrong with the raw value of a source, before anything is opened."""
    if value is None and field.optional:
        return None
    items = value if isinstance(value, list | tuple) else [value]
    if len(items) != 1 and not (field.many and items):
        return (
            f"takes {'at least one' if field.many else 'one'} {field.kind.word}, got {len(items)}"
        )
    return next(filter(None, (_item_problem(field, item) for item in items)), None)


def _item_problem(field: Field, item: Any) -> str | None:
    if field.kind.accepts(item):
        return None
    how = dict(item) if isinstance(item, Mapping) else {"path": item}
    path = how.pop("path", None)
    if not isinstance(path, str | Path) or not str(path):
        return f"must be a path or a {field.kind.word}, got {item!r}"
    try:
        parsed_options(how, field.kind.open_options)
        there = Path(path).exists()
    except (ValueError, OSError) as err:
        return str(err)
    return None if there else f"there is no file {path}"


def _target_problems(
    targets: Mapping[str, Target], sources: Mapping[str, Any], *, overwrite: bool
) -> dict[str, str]:
    found = {name: text for name, target in targets.items() if (text := target.problem())}
    good = {name: target for name, target in targets.items() if name not in found}
    reads = [path for value in sources.values() for path in _paths(value)]
    return found | files.problems(
        {name: target.home for name, target in good.items() if target.home},
        {name: target.suffixes for name, target in good.items()},
        {name: target.parts for name, target in good.items()},
        reads,
        overwrite=overwrite,
    )


def _opened(
    spec: Spec, sources: Mapping[str, Any], crs: CRS | None, ctx: Context
) -> dict[str, Any]:
    layers, problems = {}, {}
    for index, (name, value) in enumerate(sources.items()):
        part = ctx.part(index / len(sources), (index + 1) / len(sources))
        try:
            layers[name] = _open(spec.sources[name], value, crs, part)
        except (ValueError, OSError) as err:
            problems[name] = str(err)
    if problems:
        raise DataError(spec.id, problems)
    return layers


def _open(field: Field, value: Any, crs: CRS | None, ctx: Context) -> Any:
    made = field.parse(_openable(value, ctx))
    if crs is None or made is None:
        return made
    assumed = tuple(_with_crs(layer, crs) for layer in field.items(made))
    return assumed if field.many else assumed[0]


def _openable(value: Any, ctx: Context) -> Any:
    """Paths become mappings that say how to open them; layers and None stay as they are."""
    if isinstance(value, list | tuple):
        return tuple(_openable(item, ctx) for item in value)
    if isinstance(value, Mapping):
        return dict(value) | {"ctx": ctx}
    return {"path": value, "ctx": ctx} if isinstance(value, str | Path) else value


def _with_crs(layer: Any, crs: CRS) -> Any:
    if not hasattr(layer, "with_crs"):
        return layer
    if layer.crs is None:
        return layer.with_crs(crs)
    if not same_crs(layer.crs, crs):
        known, given = describe_crs(layer.crs), describe_crs(crs)
        log.warning("%s states its CRS, %s; %s is not assumed", layer.name, known, given)
    return layer


def _drawable(found: Mapping[str, Any]) -> dict[str, Any]:
    """The layers that hold anything to see."""
    maps = {n: v for n, v in found.items() if isinstance(v, PointCloud | Raster | Vector)}
    return {n: v for n, v in maps.items() if isinstance(v, Raster) or len(v)}


def _write(
    spec: Spec,
    found: Mapping[str, Any],
    targets: Mapping[str, Target],
    overwrite: bool,
    ctx: Context,
) -> dict[str, Path]:
    """Write what was asked for, all or nothing, and say where it is."""
    there = {n: t for n, t in targets.items() if n == "picture" or found[n] is not None}
    if not _drawable(found):
        there.pop("picture", None)
    for name in targets.keys() - there.keys():
        log.warning("%s: there is nothing to write", name)
    homes = {name: target.home for name, target in there.items() if target.home}
    try:
        parts = {home: there[name].parts for name, home in homes.items()}
        with files.staged(parts, overwrite=overwrite) as places:
            for index, (name, home) in enumerate(homes.items()):
                part = ctx.part(index / len(homes), (index + 1) / len(homes))
                try:
                    _save(name, found, there[name], places[home], part)
                except (OSError, DataError) as err:
                    text = str(err).replace(str(places[home]), str(there[name].path))
                    if shutil.disk_usage(places[home].parent).free < FULL:
                        text += "; the disk is full"
                    raise DataError(spec.id, {name: text}) from err
            ctx.progress(1.0)
    except OSError as err:
        raise DataError(f"{spec.id}: cannot write: {err}") from err
    return {name: target.path for name, target in there.items() if target.path}


def _save(name: str, found: Mapping[str, Any], target: Target, place: Path, ctx: Context) -> None:
    if name == "picture":
        draw(_drawable(found), place)
    else:
        found[name].save(place, ctx=ctx, **parsed_options(target.options, target.known))
