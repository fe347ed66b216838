"""Memory of a process that is ours alone: kept when it is freed, until the process ends."""

from __future__ import annotations

import ctypes
import gc
import sys

TRIM_THRESHOLD, MMAP_MAX = -1, -4  # what mallopt sets, by the numbers of malloc.h
NEVER = -1
SELDOM = 300_000  # new objects between two looks; 700 else. A chain loads some 190,000


def give_back() -> None:
    """Hand freed memory that is kept back to the system; what is in use stays."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def keep_memory() -> None:
    """Have the C library keep memory that is freed, for the next array.

    Large arrays are else mapped anew each time, and the system clears them page by page: a tenth of
    the processor time of a chain, a quarter in tiles. The peak grows by two hundredths. Only glibc
    can be told so; a program that merely imports the toolbox decides itself. Nor does Python look
    often for objects that hold each other: what is loaded stays anyway.
    """
    gc.set_threshold(SELDOM)
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(MMAP_MAX, 0)
        mallopt(TRIM_THRESHOLD, NEVER)
