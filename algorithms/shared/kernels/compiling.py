"""Decorators for compiled functions that only other compiled functions call."""

from __future__ import annotations

from numba import njit

# Python cannot call a helper, and its code is kept in the cache of those that call it. That saves
# a sixth of the time of compiling. What Python calls, a kernel, has @njit(cache=True, nogil=True).
helper = njit(  # type: ignore[call-overload]  # numba's own stubs know only some of its options
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
