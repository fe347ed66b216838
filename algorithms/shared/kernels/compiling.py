"""Decorators for compiled functions: kernels, which Python calls, and what only kernels call."""

from __future__ import annotations

import secrets
from functools import partial

from numba import njit
from numba.core.bytecode import FunctionIdentity

# numba tells compiled functions of one name apart by a number that each process counts from 1, and
# keeps it in the cache. Two processes that fill the cache at the same time may so give one name to
# two functions, such as the insides of np.sort and of np.argsort; a process that reads both later
# takes one for the other: wrong values, or a crash (numba issue 10486). So the numbers are drawn.
FunctionIdentity._unique_ids = iter(  # type: ignore[assignment]  # all that numba asks is the next
    partial(secrets.randbits, 63), None
)

# What Python calls: kept in the cache, and not held up by other threads.
kernel = njit(cache=True, nogil=True)

# A helper cannot be called by Python, and its code is kept in the cache of those that call it. That
# saves a sixth of the time of compiling.
helper = njit(  # type: ignore[call-overload]
    nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
)

# A helper that only adds up whole numbers, whose sums are exact: so they may be made in any order,
# several at once, which rounding would forbid otherwise.
exact_sums = njit(  # type: ignore[call-overload]
    nogil=True,
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    fastmath={"reassoc", "nsz"},
)

# A helper whose sums are made in any order, several at once, and rounded accordingly: what comes of
# them must not depend on it.
rough_sums = njit(  # type: ignore[call-overload]
    nogil=True,
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    fastmath={"reassoc", "nsz", "contract"},
)

# A helper that becomes a part of each loop that calls it, and divides without asking for zero: so
# that a loop without branches computes several values at once.
inlined = njit(  # type: ignore[call-overload]
    nogil=True,
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    forceinline=True,
    error_model="numpy",
)
