"""Run a tool by its id: paths in, layers or paths out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox import catalog, files
from toolbox.context import QUIET, Context
from toolbox.data.crs import parse_crs
from toolbox.errors import DataError, ParameterError
from toolbox.fields import Field, Spec, nearest
from toolbox.picture import draw

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
        ``{"path": "a.txt", "columns": ["x", "y", "z", "label"]}``. Texts are read as on the
        command line.
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
    targets = {n: v for n, v in values.items() if n in spec.outputs and v is not None}
    if picture is not None:
        targets["picture"] = picture
    given = {name: value for name, value in values.items() if name not in spec.outputs}
    settings = _checked(spec, given, targets, overwrite=overwrite)
    crs = _crs(assume_crs, id)
    sources = {name: value for name, value in given.items() if name in spec.sources}
    layers = _opened(spec, sources, crs, ctx.part(0, READ))
    result = spec.build(settings | layers).run(ctx.part(READ, WRITE))
    found = {name: getattr(result, name) for name in spec.outputs}
    paths = {name: Path(target) for name, target in targets.items()}
    _write(spec, found, paths, ctx.part(WRITE, 1))
    return found | paths


def _crs(crs: str | CRS | None, where: str) -> CRS | None:
    try:
        return parse_crs(crs) if isinstance(crs, str) else crs
    except ValueError as err:
        raise ParameterError(where, {"assume_crs": str(err)}) from None


def _checked(
    spec: Spec, given: Mapping[str, Any], targets: Mapping[str, Any], *, overwrite: bool
) -> dict[str, Any]:
    """The values that are no layers. What can be checked without data is checked here."""
    sources = {name: value for name, value in given.items() if name in spec.sources}
    settings = {name: value for name, value in given.items() if name not in spec.sources}
    values, problems = spec.parse(settings, present=sources)
    for name in given.keys() - spec.inputs.keys():
        known = [*spec.inputs, *spec.outputs]
        problems[name] = f"unknown parameter{nearest(name, known)}"
    problems |= _source_problems(sources)
    problems |= _target_problems(spec, targets, sources, overwrite=overwrite)
    if problems:
        raise ParameterError(spec.id, dict(sorted(problems.items())))
    return values


def _paths(value: Any) -> list[Path]:
    """The files that the raw value of a source names."""
    if isinstance(value, list | tuple):
        return [path for item in value for path in _paths(item)]
    if isinstance(value, Mapping):
        return _paths(value.get("path"))
    return [Path(value)] if isinstance(value, str | Path) else []


def _source_problems(sources: Mapping[str, Any]) -> dict[str, str]:
    found = {}
    for name, value in sources.items():
        if isinstance(value, Mapping) and "path" not in value:
            found[name] = f"needs a path, got {sorted(value)}"
        if missing := [str(path) for path in _paths(value) if not path.exists()]:
            found[name] = f"there is no file {', '.join(missing)}"
    return found


def _target_problems(
    spec: Spec, targets: Mapping[str, Any], sources: Mapping[str, Any], *, overwrite: bool
) -> dict[str, str]:
    endings = {name: field.kind.suffixes for name, field in spec.outputs.items()}
    endings["picture"] = (".png",)
    found, paths = {}, {}
    for name, target in targets.items():
        if not endings[name]:
            found[name] = "is a value, which is printed; it cannot be written to a file"
        elif not isinstance(target, str | Path) or not str(target):
            found[name] = f"must be a path, got {target!r}"
        else:
            paths[name] = Path(target)
    reads = [path for value in sources.values() for path in _paths(value)]
    return found | files.problems(paths, endings, reads, overwrite=overwrite)


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
    if crs is None:
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
    known = not hasattr(layer, "with_crs") or layer.crs is not None
    return layer if known else layer.with_crs(crs)


def _write(spec: Spec, found: Mapping[str, Any], paths: Mapping[str, Path], ctx: Context) -> None:
    """Write what was asked for, all or nothing."""
    try:
        with files.staged(paths.values()) as places:
            for index, (name, path) in enumerate(paths.items()):
                part = ctx.part(index / len(paths), (index + 1) / len(paths))
                if name == "picture":
                    draw({n: v for n, v in found.items() if hasattr(v, "save")}, places[path])
                else:
                    found[name].save(places[path], ctx=part)
            ctx.progress(1.0)
    except OSError as err:
        raise DataError(f"{spec.id}: cannot write: {err}") from err
