"""How layers in memory were made, so that a product of several runs in Python says all its steps.

What a run gives without a file is remembered as long as it lives, without the layers that the run
has read. A layer that was made or changed in Python is another one: it has its content, and no run.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from toolbox.context import log
from toolbox.data.crs import crs_text
from toolbox.data.layer import Layer, text_array
from toolbox.data.reading import file_hash
from toolbox.errors import DataError
from toolbox.runs.provenance import Record

_known: dict[int, Origin] = {}  # by the identity of layers that live


@dataclass(frozen=True, eq=False)
class Origin:
    """What is known of a layer in memory.

    Attributes
    ----------
    content : SHA-256 of what it holds, if no run made it
    describe : gives the record that its file would carry, if a run made it
    before : what is known of the layers in memory that the run has read
    """

    content: str = ""
    describe: Callable[[], Record] | None = field(default=None, repr=False)
    before: tuple[Origin, ...] = ()

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
        """Of the content, or of the record where a run made it; "" if neither is known."""
        steps = [self]
        for step in steps:  # the first steps first: a chain may be longer than calls may be deep
            steps += [one for one in step.before if "sha256" not in vars(one) and one not in steps]
        for step in reversed(steps[1:]):
            _ = step.sha256
        if self.record is None:
            return self.content
        return hashlib.sha256(json.dumps(self.record.entry()).encode()).hexdigest()


def of(layer: Layer) -> Origin:
    """What is known of a layer in memory."""
    return _known.get(id(layer)) or Origin(content_hash(layer))


def remember(layer: Layer, origin: Origin) -> None:
    """Remember what is known of a layer as long as it lives."""
    if id(layer) not in _known:  # a tool may give what it was given
        _known[id(layer)] = origin
        weakref.finalize(layer, _known.pop, id(layer), None).atexit = False


def content_hash(layer: Layer) -> str:
    """SHA-256 of the content of a layer, in memory and in files."""
    made = hashlib.sha256(crs_text(layer.crs).encode())
    of_files = ((path.name, text_array(file_hash(path))) for path in layer.paths)
    for name, values in itertools.chain(layer.contents(), of_files):
        array = np.ascontiguousarray(values)
        made.update(f"{name} {array.dtype.str} {array.shape}".encode())
        made.update(array.data if array.size else b"")
    return made.hexdigest()
