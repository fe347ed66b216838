"""Openings of fronts of many kinds: found, missed and invented."""

from __future__ import annotations

import argparse

from tests.bench.facades import Score, score
from tests.bench.measuring import say


def house_fronts(*options: str) -> None:
    """Fronts of every kind with truth: openings found, and those that are none.

    The option `--seeds FIRST LAST` tells which: the method was chosen on 0 to 99, and 400 to 499
    are for reporting alone. `--kinds` names some of the kinds.
    """
    from tests.scenes.house_fronts import KINDS

    reader = argparse.ArgumentParser(prog="house_fronts")
    reader.add_argument("--seeds", type=int, nargs=2, default=(404, 405))
    reader.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    given = reader.parse_args(options)
    first, last = given.seeds
    whole = []
    for kind in given.kinds:
        scores = [_front(kind, seed) for seed in range(first, last + 1)]
        say(f"house_fronts  {kind:18} {_summed(scores)}")
        whole += scores
    say(f"house_fronts  {'all':18} {_summed(whole)}")


def _front(kind: str, seed: int) -> Score:
    import shapely

    from algorithms.planes.extract import PlanesExtract
    from algorithms.planes.openings import PlanesOpenings
    from tests.scenes.house_fronts import house_front

    made = house_front(kind, seed)
    planes = PlanesExtract(points=made.cloud()).run()
    out = PlanesOpenings(points=planes.segmented).run()
    found = [shapely.get_coordinates(s, include_z=True) for s in out.openings.frame.geometry]
    scored = score(made.openings, found)
    return scored._replace(found=len(found))  # of side walls, too, which have none


def _summed(scores: list[Score]) -> str:
    """All openings of several fronts together, and F1 of each front."""
    right, true, found = (sum(one[k] for one in scores) for k in range(3))
    each = " ".join(f"{one.f1:.2f}" for one in scores)
    return (
        f"{right} of {true} openings, {found - right} invented, "
        f"F1 {2 * right / max(true + found, 1):.2f} (each {each})"
    )
