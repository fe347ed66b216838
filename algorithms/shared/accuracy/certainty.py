"""What makes intervals of blocks too narrow, said in warnings."""

from __future__ import annotations

import numpy as np

from algorithms.shared.accuracy.blocks import LEAST, Blocks, Clumping
from toolbox.context import log


def warn_blocks(ground: Blocks, what: str) -> None:
    """Warn of so few blocks that intervals are too narrow, or not known.

    Parameters
    ----------
    ground : blocks that hold something
    what : they hold, such as "points" or "cells"
    """
    count, squares = len(ground), len(np.unique(ground.square))
    if count < LEAST:
        text = "only %d blocks hold %s: below %d there are no intervals of blocks; lower block"
        log.warning(text, count, what, LEAST)
    elif squares < LEAST:
        log.warning(
            "only %d squares of four blocks hold %s: below %d, intervals do not see whether "
            "errors are wider than a block, and are too narrow if so; lower block",
            squares,
            what,
            LEAST,
        )


def warn_clumps(found: Clumping | None) -> None:
    """Warn of errors that come in few clumps, or in clumps wider than blocks."""
    if found is not None and found.few:
        log.warning(
            "the errors are as uncertain as %.1f independent ones: of so few, intervals hold the "
            "truth in fewer than 95 of 100 cases; take a larger area",
            found.clumps,
        )
    elif found is not None and found.wide:
        log.warning(
            "errors are wider than blocks (the variance of squares of four is %.1f times that of "
            "blocks): intervals are widened for it, and may still be too narrow; take a larger "
            "area",
            found.growth,
        )
