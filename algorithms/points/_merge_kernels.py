"""Compiled loop of points.merge."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import kernel


@kernel
def mark(first, last, order, starts, xyz, file, near, marks):
    """Mark the points of groups that also occur in an earlier file.

    Parameters
    ----------
    first, last : groups to look at
    order, starts : points by group, and where those of each group begin
    xyz : array of shape (n, 3)
    file : array of shape (n,)
    near : largest difference of x, of y and of z
    marks : array of shape (n,), to set
    """
    for group in range(first, last):
        some = order[starts[group] : starts[group + 1]]
        for i in some:
            for j in some:
                if file[j] < file[i] and np.abs(xyz[i] - xyz[j]).max() <= near:
                    marks[i] = True
                    break
