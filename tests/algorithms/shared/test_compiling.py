"""Names of compiled functions."""

from __future__ import annotations

import subprocess
import sys

NUMBER = """
from numba.core.bytecode import FunctionIdentity
from algorithms.shared.kernels import compiling

print(FunctionIdentity.from_function(lambda: 0).unique_id)
"""


def test_two_processes_never_give_two_functions_one_name() -> None:
    run = [sys.executable, "-c", NUMBER]
    numbers = [subprocess.run(run, capture_output=True, check=True).stdout for _ in range(2)]
    assert numbers[0] != numbers[1]
    assert all(int(number) > 2**32 for number in numbers)  # so no small one of a user's own tool
