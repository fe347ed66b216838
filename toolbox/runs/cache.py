"""Results of steps, kept on disk so that later runs need not compute them again: ``--resume``.

A result goes by a key: the SHA-256 of the code, the tool, its settings and the layers that it is
given. A layer that was read from a file goes by what it holds, so that a file of another name, or
written again, is the same, and one that was read otherwise (columns, CRS) is not. A layer that
another step has made goes by the key of that step.

What is trusted: entries are pickles of our own layers, and a pickle can run any code when it is
read. So the folder belongs to the user alone; one that others may write in is refused. A damaged
entry is noticed by its checksum, and computed again.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO
from weakref import WeakKeyDictionary

from toolbox import files, places
from toolbox.context import Context, listening, log
from toolbox.data.layer import Layer
from toolbox.data.reading import file_hash
from toolbox.declare.fields import Field, Spec
from toolbox.errors import ParameterError
from toolbox.models.model import Runner, run_tool

LIMIT = 20e9  # bytes of all entries
FOLDER_VARIABLE, LIMIT_VARIABLE = "TOOLBOX_CACHE", "TOOLBOX_CACHE_LIMIT"
SUFFIX = ".result"
DIGEST = hashlib.sha256().digest_size
BLOCK = 2**22  # bytes


def folder() -> Path:
    """Folder in which results are kept."""
    return places.cache(FOLDER_VARIABLE, "steps")


def limit() -> float:
    """Largest total size of the kept results, in bytes.

    Raises
    ------
    ParameterError
        The environment says something else than a number.
    """
    said = os.environ.get(LIMIT_VARIABLE, str(LIMIT))
    try:
        return float(said)
    except ValueError:
        text = f"must be a number of bytes, got {said!r}"
        raise ParameterError("resume", {LIMIT_VARIABLE: text}) from None


def _setting(field: Field, value: Any) -> Any:
    """A setting as JSON; of a file what it holds."""
    if field.kind.word == "file" and value is not None and Path(value).is_file():
        return file_hash(Path(value))
    return field.to_json(value)


@dataclass
class Cache:
    """Results of earlier runs on disk, and the keys of the layers of this run."""

    place: Path = field(default_factory=folder)
    limit: float = field(default_factory=limit)
    keys: WeakKeyDictionary[Any, str] = field(default_factory=WeakKeyDictionary)

    def runner(self, inner: Runner = run_tool) -> Runner:
        """Runner for `ModelRun.runner` that asks the cache before `inner` runs a tool."""
        return lambda name, job, ctx: inner(name, _Cached(job, name, self), ctx)

    def __post_init__(self) -> None:
        """Raise an error for a folder in which others may write, since it holds pickles."""
        if self.place.exists() and not files.is_private(self.place):
            text = "must be a folder in which only you may write"
            raise ParameterError("resume", {FOLDER_VARIABLE: f"{self.place} {text}"})

    def run(self, name: str, job: Any, ctx: Context) -> Any:
        """The result of a tool, from the cache or by running it."""
        key = self._key(job)
        kept = self._load(key)
        if kept:
            log.info("step %s: unchanged, taken from the cache", name)
            for text in kept["warnings"]:
                log.warning("%s", text)
            ctx.progress(1.0)
            found: Any = SimpleNamespace(**kept["values"])
        else:
            with listening() as warnings:
                found = job.run(ctx)
        layers = dict(_outputs(job.spec, found))
        keys = kept["keys"] if kept else self._keys_of(layers, key)
        for output, layer in layers.items():
            self.keys[layer] = keys[output]
        if not kept:
            values = {output: getattr(found, output) for output in job.spec.outputs}
            self._store(key, {"values": values, "keys": keys, "warnings": warnings})
        return found

    def _keys_of(self, layers: Mapping[str, Any], run: str) -> dict[str, str]:
        """The key of each layer: that of the run with its name, or its own if it was handed on."""
        return {name: self.keys.get(layer, f"{run} {name}") for name, layer in layers.items()}

    def _key(self, job: Any) -> str:
        spec: Spec = job.spec
        values = {name: getattr(job, name) for name in spec.inputs}
        says = {
            "code": code_of(str(spec.make.__module__).partition(".")[0]),
            "tool": spec.id,
            "settings": {
                n: _setting(f, values[n]) for n, f in spec.inputs.items() if f.role == "param"
            },
            "layers": {n: [*self._layers(f, values[n])] for n, f in spec.sources.items()},
        }
        return hashlib.sha256(json.dumps(says, sort_keys=True).encode()).hexdigest()

    def _layers(self, source: Field, value: Any) -> Iterator[str | None]:
        for layer in source.items(value):
            if layer is not None and layer not in self.keys:
                self.keys[layer] = content_of(layer)
            yield None if layer is None else self.keys[layer]

    def _load(self, key: str) -> dict[str, Any] | None:
        """The result kept under a key; None if there is none or it is damaged."""
        path = self.place / (key + SUFFIX)
        try:
            with path.open("rb") as file:
                if not _is_whole(file):
                    raise pickle.UnpicklingError("its checksum is wrong")
                file.seek(0)
                found: dict[str, Any] = pickle.load(file)
            os.utime(path)  # those that were not used for longest go first
        except FileNotFoundError:
            return None
        except Exception as err:  # noqa: BLE001  whatever is wrong with it: it can be made again
            log.warning("%s in the cache is not used: %s", path.name, err)
            return None
        return found

    def _store(self, key: str, kept: Mapping[str, Any]) -> None:
        """Keep a result under a key; after a failure nothing is there."""
        path = self.place / (key + SUFFIX)
        try:
            self.place.mkdir(mode=0o700, parents=True, exist_ok=True)
            whole = files.staged({path: files.itself}, overwrite=True)
            with whole as places, open(places[path], "wb", opener=_own) as file:
                writer = _Hashing(file)
                pickle.dump(dict(kept), writer, protocol=5)
                file.write(writer.hash.digest())
            self._prune()
        except OSError as err:  # the run itself has all it needs
            log.warning("a result is not kept in the cache: %s", err)

    def _prune(self) -> None:
        """Remove the results longest unused until the limit is kept."""
        entries = [(path.stat(), path) for path in self.place.glob("*" + SUFFIX)]
        total = sum(stat.st_size for stat, _ in entries)
        for stat, path in sorted(entries, key=lambda entry: entry[0].st_mtime_ns):
            if total <= self.limit:
                return
            path.unlink(missing_ok=True)
            total -= stat.st_size


def _own(path: str, flags: int) -> int:
    """Open a file that only the user may read, whatever the folder is."""
    return os.open(path, flags, 0o600)


def _is_whole(file: BinaryIO) -> bool:
    """Whether a file ends with the checksum of its other bytes."""
    size = os.fstat(file.fileno()).st_size - DIGEST
    made = hashlib.sha256()
    while file.tell() < size and (block := file.read(min(BLOCK, size - file.tell()))):
        made.update(block)
    return made.digest() == file.read()


def _outputs(spec: Spec, result: Any) -> Iterator[tuple[str, Any]]:
    """The layers of a result, each with a name made of output and index."""
    for name, output in spec.outputs.items():
        if output.kind.is_layer:
            for place, layer in enumerate(output.items(getattr(result, name))):
                if layer is not None:
                    yield f"{name} {place}", layer


class _Cached:
    """A job (a tool with its values) that asks the cache before it runs."""

    def __init__(self, job: Any, name: str, cache: Cache) -> None:
        self._job, self._name, self._cache = job, name, cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._job, name)

    def run(self, ctx: Context) -> Any:
        return self._cache.run(self._name, self._job, ctx)


class _Hashing:
    """A writable file that hashes what is written; without an inner file it only hashes."""

    def __init__(self, file: Any = None) -> None:
        self.file, self.hash = file, hashlib.sha256()

    def write(self, data: Any) -> None:
        self.hash.update(data)
        if self.file:
            self.file.write(data)


def content_of(layer: Layer) -> str:
    """Hash of the content of a layer, the same in every process."""
    made = _Hashing()
    made.hash.update("".join(map(file_hash, layer.paths)).encode())
    pickle.dump(layer, made, protocol=5)
    return made.hash.hexdigest()


@functools.cache
def code_of(package: str) -> str:
    """Hash of the Python files of the toolbox and of a package, which changes with each version."""
    made = hashlib.sha256()
    for name in dict.fromkeys(["toolbox", package]):
        found = find_spec(name) if name != "__main__" else None
        places = found.submodule_search_locations if found else None
        paths = [path for place in places or [] for path in Path(place).rglob("*.py")]
        paths += [Path(found.origin)] if found and found.origin and not places else []
        for path in sorted(paths):
            made.update(path.read_bytes())
    return made.hexdigest()
