"""How layers in memory were made, so that a product of several runs in Python says all its steps.

What a run gives without a file is remembered as long as it lives, without the layers that the run
has read. A layer that was made or changed in Python is another one: it has its content, and no run.
Nothing is hashed before a record is written, but the content of a layer that goes while what a run
made of it stays: nobody can change the arrays of a layer in place, so either hash is the same.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import weakref
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from toolbox.context import log
from toolbox.data.crs import crs_text
from toolbox.data.layer import Layer, text_array
from toolbox.data.reading import Reading
from toolbox.errors import DataError
from toolbox.runs.provenance import Record

_known: dict[int, Origin] = {}  # by the identity of layers that live


@dataclass(eq=False)
class Origin:
    """What is known of a layer in memory.

    Attributes
    ----------
    describe : gives the record that its file would carry, if a run made it
    before : what is known of the layers in memory that the run has read
    held : a copy that shares its arrays, as long as it lives, if no run made it
    reading : what is known of the files that hold what it does not have in memory
    """

    describe: Callable[[], Record] | None = field(default=None, repr=False)
    before: tuple[Origin, ...] = ()
    held: Layer | None = field(default=None, repr=False)
    reading: Reading = field(default_factory=Reading, repr=False)

    @cached_property
    def record(self) -> Record | None:
        """The record; None if no run made it, or a file that the run has read is another now."""
        if self.describe is None:
            return None
        try:
            return self.describe()
        except DataError as error:
            log.warning("%s; how a layer in memory was made is not passed on", error)
            return None

    @cached_property
    def sha256(self) -> str:
        """Of the record if a run made it, else of the content; "" where a file has changed."""
        steps = [self]
        for step in steps:  # the first steps first: a chain may be longer than calls may be deep
            steps += [one for one in step.before if "sha256" not in vars(one) and one not in steps]
        for step in reversed(steps[1:]):
            _ = step.sha256
        if self.held is not None:
            return self._content(self.held)
        if self.record is None:
            return ""
        return hashlib.sha256(json.dumps(self.record.entry()).encode()).hexdigest()

    def _content(self, layer: Layer) -> str:
        try:
            check_unchanged(self.reading)
            return content_hash(layer, self.reading)
        except DataError as error:
            log.warning("%s; how a layer in memory was made is not passed on", error)
            return ""

    def settle(self) -> None:
        """Hash the arrays and let them go, since the layer goes; files can be hashed later."""
        if self.held is not None and not self.held.paths:
            _ = self.sha256
            self.held = None


def check_unchanged(reading: Reading) -> None:
    """Raise an error if files are not any more what they were when a run had read them.

    Raises
    ------
    DataError
        Names the files.
    """
    if changed := reading.changed():
        raise DataError(f"{', '.join(map(str, changed))} changed after a run had read it")


def of(layer: Layer) -> Origin:
    """What is known of a layer in memory; it is hashed no sooner than that is asked for."""
    known = _known.get(id(layer))
    if known is None:
        remember(layer, Origin(held=copy(layer), reading=Reading.of(layer.paths)))
    elif known.reading.changed():  # what is read now is another content
        _known[id(layer)] = Origin(held=copy(layer), reading=Reading.of(layer.paths))
    return _known[id(layer)]


def remember(layer: Layer, origin: Origin) -> None:
    """Remember what is known of a layer as long as it lives."""
    if id(layer) not in _known:  # a tool may give what it was given
        _known[id(layer)] = origin
        weakref.finalize(layer, _forget, id(layer)).atexit = False


def _forget(identity: int) -> None:
    """Forget a layer that goes; its content is hashed only if what was made of it is still here."""
    still = weakref.ref(_known.pop(identity))
    if (origin := still()) is not None:
        origin.settle()


def content_hash(layer: Layer, reading: Reading) -> str:
    """SHA-256 of the content of a layer, in memory and in files.

    Parameters
    ----------
    reading : what is known of the files; the others are read for their hashes
    """
    made = hashlib.sha256(crs_text(layer.crs).encode())
    of_files = ((path.name, text_array(reading.hash_of(path))) for path in layer.paths)
    for name, values in itertools.chain(layer.contents(), of_files):
        array = np.ascontiguousarray(values)
        made.update(f"{name} {array.dtype.str} {array.shape}".encode())
        made.update(array.data if array.size else b"")
    return made.hexdigest()
