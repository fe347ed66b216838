"""Sources: the layers that a run reads, parsed once, checked, and then opened."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data.area_of_use import misplaced
from toolbox.data.crs import describe_crs, same_crs
from toolbox.data.layer import Layer
from toolbox.data.paths import PointFiles, missing
from toolbox.data.reading import Reading
from toolbox.data.remote.address import Address, as_path
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import Kind, parsed_options
from toolbox.errors import DataError, ToolboxError
from toolbox.runs.origins import Origin


@dataclass(frozen=True)
class Source:
    """A layer that a run reads, in memory or in files.

    Attributes
    ----------
    layer : in memory; None if it is in files
    paths : paths as they were given, of points also of folders, patterns and VPCs
    options : how it is opened, as its kind takes them
    several : whether many files may be one layer
    problem : what is wrong with it, as far as that is known before it is opened
    origin : what is known of a layer that was in memory, and is not needed any more
    """

    layer: Any = None
    paths: tuple[str | Path, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    several: bool = False
    problem: str | None = None
    origin: Origin | None = None

    @classmethod
    def of(cls, kind: Kind, value: Any) -> Source:
        """Parse a layer, a path, a mapping of a path and options, or a list of these."""
        if kind.accepts(value):
            return cls(layer=value)
        items = value if isinstance(value, list | tuple) else [value]
        hows = [dict(item) if isinstance(item, Mapping) else {"path": item} for item in items]
        paths = [how.pop("path", None) for how in hows]
        if len(paths) == 1 and isinstance(paths[0], list):
            paths = paths[0]
        made = cls(paths=tuple(paths), several=kind.several)
        try:
            if any(how != hows[0] for how in hows):
                raise ValueError("the files of one layer must be opened with the same options")
            options = parsed_options(hows[0] if hows else {}, kind.open_options)
            return replace(made, options=options, problem=_problem(kind, paths, value))
        except OSError as err:
            return replace(made, problem=f"{err.filename} cannot be read: {err.strerror}")
        except ValueError as err:
            return replace(made, problem=str(err))

    @cached_property
    def points(self) -> PointFiles:
        """The point files that the paths stand for.

        Raises
        ------
        DataError
            They cannot be found.
        """
        return PointFiles.of(self.paths, self.options.get("bounds"))

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that are read; none for a layer in memory.

        Raises
        ------
        DataError
            They cannot be found.
        """
        return self.points.paths if self.several else tuple(map(as_path, self.paths))

    def absolute(self) -> Source:
        """The same source with absolute paths, for a process with another working folder."""
        return replace(self, paths=tuple(as_path(path).absolute() for path in self.paths))

    def open(
        self,
        kind: Kind,
        crs: CRS | None = None,
        reading: Reading | None = None,
        ctx: Context = QUIET,
    ) -> Any:
        """Open the layer.

        Parameters
        ----------
        kind : of the layer; that of a model may be wider than the one which the source was made of
        crs : of a layer that states none
        reading : where the hashes of files that are read from end to end are noted

        Raises
        ------
        DataError, ValueError, OSError
            It cannot be read.
        """
        made = self._read(kind, crs, reading, ctx) if self.layer is None else self.layer
        made = made.assuming(crs)
        check_place(made, crs)
        if self.several and "bounds" in self.options and not len(made):
            log.warning("%s: no point lies within bounds; info says where they are", made.name)
        return made

    def _read(self, kind: Kind, crs: CRS | None, reading: Reading | None, ctx: Context) -> Any:
        assert kind.open is not None
        known = {"assume_crs": crs} if "assume_crs" in kind.open_options else {}
        how: dict[str, Any] = {**known, **self.options}
        try:
            if not self.several:
                return kind.open(self.paths[0], ctx=ctx, **how)
            return kind.open(self.points, ctx=ctx, reading=reading, **how)
        except ToolboxError:
            raise
        except (ValueError, TypeError) as err:
            given = self.paths[0] if len(self.paths) == 1 else list(self.paths)
            raise ValueError(f"must be a {kind.word}, got {given!r}: {err}") from None


Sources = Mapping[str, tuple[Source, ...]]
"""What a run reads, by parameter; several layers where the parameter takes several."""


_MADE = {  # how layers are made of what other libraries have, by the name of its type
    "ndarray": "PointCloud(xyz, crs=...) or Raster.from_lattice(values, lattice, crs=...)",
    "DataFrame": "PointCloud(frame[['x', 'y', 'z']].to_numpy(), crs=...)",
    "GeoDataFrame": "Vector(frame)",
}


def _problem(kind: Kind, paths: Sequence[Any], value: Any) -> str | None:
    """The problem with the paths of a source; None if there is none."""
    if not all(isinstance(path, str | Path) and str(path) for path in paths):
        made = _MADE.get(type(value).__name__)
        if made:
            return f"must be a path or a {kind.word}, got {type(value).__name__}; {made} makes one"
        return f"must be a path or a {kind.word}, got {value!r}"
    if len(paths) != 1 and not (kind.several and paths):
        return f"takes one {kind.word}, got {len(paths)}"
    absent = missing(paths) if kind.several else [p for p in paths if not as_path(p).exists()]
    return f"there is no file {', '.join(map(str, absent))}" if absent else None


def of_run(given: Mapping[str, Any], spec: Spec) -> dict[str, tuple[Source, ...]]:
    """Sources of a run by parameter, from the given values; parameters left out are not there."""
    fields = {name: spec.sources[name] for name in given if name in spec.sources}
    return {
        name: tuple(Source.of(field.kind, item) for item in field.given(given[name]))
        for name, field in fields.items()
        if not (field.optional and given[name] is None)
    }


def folders(sources: Sources) -> set[Path]:
    """The folders that are read as a whole, links followed."""
    given = [source for items in sources.values() for source in items if not source.problem]
    there = (as_path(path) for source in given for path in source.paths)
    return {p.resolve() for p in there if not isinstance(p, Address) and p.is_dir()}


def problems(sources: Sources, spec: Spec) -> dict[str, str]:
    """Problems of sources by parameter, found before anything is opened."""
    found: dict[str, str] = {}
    for name, items in sources.items():
        if not items:
            found[name] = f"takes at least one {spec.sources[name].kind.word}, got 0"
        for source in items:
            if source.problem:
                found.setdefault(name, source.problem)
    return found


def paths(sources: Sources) -> Iterator[Path]:
    """The files that a run reads; sources whose files cannot be found are skipped."""
    for source in (source for items in sources.values() for source in items):
        try:
            yield from source.files
        except (ValueError, TypeError, OSError):
            continue


def opened(
    spec: Spec, sources: Sources, crs: CRS | None, reading: Reading | None, ctx: Context
) -> dict[str, Any]:
    """All layers of a run by parameter; one error names all that cannot be opened.

    Parameters
    ----------
    crs : of layers that state none
    reading : where the hashes of files that are read from end to end are noted
    """
    layers, problems = {}, {}
    for index, (name, items) in enumerate(sources.items()):
        part = ctx.part(index / len(sources), (index + 1) / len(sources))
        try:
            layers[name] = open_all(spec.sources[name], items, crs, reading, part)
        except (ValueError, OSError) as err:
            problems[name] = str(err)
    if problems:
        raise DataError(spec.id, problems)
    if crs is not None:
        _tell_of_others(spec, sources, layers, crs)
    return layers


def open_all(
    field: Field,
    sources: tuple[Source, ...],
    crs: CRS | None,
    reading: Reading | None = None,
    ctx: Context = QUIET,
) -> Any:
    """The layer of a parameter, or a tuple where it takes several."""
    made = tuple(source.open(field.kind, crs, reading, ctx) for source in sources)
    return made if field.many else made[0]


def check_place(layer: Layer, assumed: CRS | None) -> None:
    """Warn of coordinates that cannot be in the CRS of their layer, or lie far from its place.

    In a CRS that is only assumed, coordinates in another unit are an error: whoever means plain
    coordinates can say so. A file may state a CRS for coordinates that were moved to an origin.

    Raises
    ------
    DataError
        The coordinates are in another unit than the CRS that is assumed.
    """
    found = misplaced(layer.crs, layer.bounds) if layer.is_spatial else None
    if found is None:
        return
    if found.in_other_unit and same_crs(layer.crs, assumed):
        raise DataError(f"{layer.name} {found.text} (assume_crs)".strip())
    log.warning("%s %s", layer.name or "the layer", found.text)


def _tell_of_others(spec: Spec, sources: Sources, layers: Mapping[str, Any], crs: CRS) -> None:
    """Warn of layers that state another CRS than the assumed one, unless that was for others."""
    found = [
        (layer, "reproject" in source.options)
        for name, items in sources.items()
        for source, layer in zip(items, spec.sources[name].items(layers[name]), strict=True)
        if layer.is_spatial
    ]
    if any(reprojected or same_crs(layer.crs, crs) for layer, reprojected in found):
        return
    for layer, _ in found:
        known, given = describe_crs(layer.crs), describe_crs(crs)
        log.warning("%s states its CRS, %s; %s is not assumed", layer.name, known, given)
