"""Classes that are learnt: on tiles and surveys that nothing was learnt from, and what it costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.bench.measuring import DATA, say

TILES = (
    *(f"ign_urban_50m/{name}.laz" for name in ("77050_627755", "77055_627755", "77060_627760")),
    "cir_ign_20cm/split_west.laz",
)
AHN3 = ("ahn3_delft_bgt/ahn3_cropped_2.laz", "ahn_amsterdam/ahn3_2386_9702.laz")
AHN4 = "ahn_amsterdam/ahn4_2463_9714_rgb.laz"
LINES = tuple(f"powerline_ahn4/{name}_as_published.laz" for name in ("12BZ1_21", "12AN2_20"))
SMOOTH = 1.5  # metres; chosen on the first two tiles
CLASSES, RADII = (2, 3, 4, 5, 6), (1.0, 2.0, 4.0)
MERGED = np.array([0, 1, 2, 5, 5, 5, 6, *range(7, 256)])  # low to high vegetation are one
OBJECTS = np.array([0, 1, 2, 1, 1, 1, 6, *range(7, 256)])  # what AHN has: ground, building, rest

LINE_CLASSES = (1, 2, 5, 14, 15)

Codes = NDArray[np.int64]
Mask = NDArray[np.bool_]


def learning() -> None:
    """Leave one tile out."""
    _left_out({name: _opened(name) for name in TILES})


def learning_elsewhere() -> None:
    """From one survey to another."""
    tiles = {name: _opened(name) for name in (*TILES, *AHN3, AHN4)}
    french = _model([tiles[name] for name in TILES], CLASSES)
    for name in (*AHN3, AHN4):
        _elsewhere(f"IGN to {name}", french, tiles[name], OBJECTS)
    dutch = _model([tiles[name] for name in (*AHN3, AHN4)], (1, 2, 6))
    for name in TILES:
        _elsewhere(f"AHN to {name}", dutch, tiles[name], OBJECTS)


def learning_drift() -> None:
    """Which figure of drift goes with the accuracy: each tile by models of one other each."""
    from scipy.stats import spearmanr

    clouds = {name: _opened(name) for name in (*TILES, *AHN3, AHN4)}
    found: list[dict[str, float]] = []
    for trained, own in clouds.items():
        made = _model([own], (1, 2, 6) if "ahn" in trained else CLASSES)
        for name, cloud in clouds.items():
            if name != trained and all(_has(cloud, feature) for feature in made.features):
                found.append(_drifted(f"{trained} to {name}", made, cloud))
    for name in found[0]:
        rank = spearmanr([row[name] for row in found], [row["accuracy"] for row in found])
        say(f"learning  {name}: its rank goes with that of accuracy, {rank.statistic:.2f}")


def _drifted(title: str, made: Any, cloud: Any) -> dict[str, float]:
    """Accuracy of ground, building and rest, in percent, and figures of drift."""
    from algorithms.classify._learning import drift

    label, given, data = _applied(made, cloud)
    true, said = OBJECTS[label], OBJECTS[given]
    known = np.isin(true, (1, 2, 6))
    rows = list(drift.rows(made, data, np.searchsorted(made.classes, given)))
    index = np.array([row["stability_index"] for row in rows])
    row = {
        "accuracy": 100 * float((true == said)[known].mean()),
        "expected": 100 * float(made.probabilities(data).max(axis=1).mean()),
        "features unlike": float(np.mean([row["verdict"] == "unlike" for row in rows])),
        "mean stability index": float(index.mean()),
        "median stability index": float(np.median(index)),
        "largest stability index": float(index.max()),
        "outside": float(drift.beyond(made, data).mean()),
    }
    say(f"learning  {title:70} " + ", ".join(f"{name} {value:.3g}" for name, value in row.items()))
    return row


def learning_lines() -> None:
    """Wires and towers of each line by a model of the other one, beside corridor.extract."""
    from algorithms.corridor.extract import CorridorExtract

    clouds = [_opened(name) for name in LINES]
    for own, other in ((0, 1), (1, 0)):
        made = _model(clouds[own : own + 1], LINE_CLASSES)
        _elsewhere(f"wires: {LINES[own]} to {LINES[other]}", made, clouds[other], np.arange(256))
        true, learnt, _ = _applied(made, clouds[other])
        found = CorridorExtract(points=clouds[other]).run().classified
        extracted = found["classification"].astype(np.int64)
        for code, name in ((14, "wires"), (15, "towers")):
            _second_opinion(
                f"{name} of {LINES[other]}", *(c == code for c in (true, learnt, extracted))
            )


def _second_opinion(title: str, true: Mask, learnt: Mask, extracted: Mask) -> None:
    """F1 of both, and of the points on which they differ how many each has right."""
    from sklearn.metrics import f1_score

    differ = learnt != extracted
    wrong = extracted != true
    say(
        f"learning  {title:50} F1 learnt {100 * f1_score(true, learnt):.1f}, "
        f"corridor.extract {100 * f1_score(true, extracted):.1f}; they differ on "
        f"{differ.sum()} points, of which corridor.extract has "
        f"{100 * (~wrong)[differ].mean():.0f} % right; of its {wrong.sum()} errors "
        f"{100 * differ[wrong].mean():.0f} % are among them"
    )


def learning_speed() -> None:
    """Time of features and probabilities against reading, of a model of one tile."""
    from toolbox.data import PointCloud

    path, cloud = DATA / TILES[0], _opened(TILES[0])
    made = _model([cloud], CLASSES)
    million = 1e6 / len(cloud)
    read = _seconds(lambda: PointCloud.open(path).xyz) * million
    data = _described(cloud, made.features)
    describe = _seconds(lambda: _described(cloud, made.features)) * million
    predict = _seconds(lambda: made.probabilities(data)) * million
    say(
        f"learning  a million points, processor: read {read:.2f} s, "
        f"{len(made.features)} features {describe:.1f} s ({describe / read:.1f} reads), "
        f"probabilities {predict:.1f} s ({predict / read:.1f} reads)"
    )


def _opened(name: str) -> Any:
    from pyproj import CRS

    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / name)
    return cloud if cloud.crs else cloud.with_crs(CRS(28992))


def _left_out(tiles: Mapping[str, Any]) -> None:
    """Each tile by a model of the other ones, and all of them together."""
    from algorithms.classify._learning.smoothing import smoothed

    true: list[Codes] = []
    chances: list[Any] = []
    said: dict[str, list[Codes]] = {"as they are": [], f"smooth {SMOOTH:g}": []}
    for name, cloud in tiles.items():
        made = _model([other for key, other in tiles.items() if key != name], CLASSES)
        label = cloud["classification"].astype(np.int64)
        known = np.isin(label, CLASSES)
        true.append(label[known])
        chance = made.probabilities(_described(cloud, made.features))
        chances.append(chance[known])
        shared = smoothed(chance, made.classes, cloud.xyz / cloud.metre, SMOOTH)
        for (how, found), values in zip(said.items(), (chance, shared), strict=True):
            found.append(made.classes[values.argmax(axis=1)].astype(np.int64)[known])
            expected = f"{100 * values[known].max(axis=1).mean():.2f} % expected"
            _say(f"others to {name}, {how}, {expected}", true[-1], found[-1])
    for how, found in said.items():
        _say(f"all four, each left out, {how}", np.concatenate(true), np.concatenate(found))
    for name, chance, label in zip(tiles, chances, true, strict=True):
        _reliability(name, chance, np.searchsorted(CLASSES, label))
    _reliability(
        "all four", np.concatenate(chances), np.searchsorted(CLASSES, np.concatenate(true))
    )


def _reliability(title: str, chance: Any, true: Codes) -> None:
    """Expected calibration error, Brier score, and what is right of each tenth of probability."""
    best, right = chance.max(axis=1), chance.argmax(axis=1) == true
    place = np.minimum((best * 10).astype(int), 9)
    count = np.bincount(place, minlength=10)
    said, held = (np.bincount(place, of, minlength=10) for of in (best, right))
    brier = ((chance - np.eye(chance.shape[1])[true]) ** 2).sum(axis=1).mean()
    say(
        f"learning  {title}: expected calibration error "
        f"{100 * np.abs(said - held).sum() / len(true):.2f} %, Brier score {brier:.4f}"
    )
    if title != "all four":
        return
    for k in np.flatnonzero(count):
        say(
            f"learning    probability {k / 10:.1f} to {(k + 1) / 10:.1f}: {count[k]:7,} points, "
            f"said {100 * said[k] / count[k]:.1f} %, right {100 * held[k] / count[k]:.1f} %"
        )


def _say(title: str, true: Codes, said: Codes) -> None:
    from sklearn.metrics import accuracy_score, f1_score, jaccard_score

    three = MERGED[true], MERGED[said]
    iou = jaccard_score(*three, average=None, labels=[2, 5, 6])
    f1 = f1_score(true, said, average=None, labels=CLASSES)
    say(
        f"learning  {title:80} three classes {100 * accuracy_score(*three):5.2f} %, "
        f"IoU of ground, vegetation, building {_percents(iou)}; "
        f"five classes {100 * accuracy_score(true, said):5.2f} %, F1 {_percents(f1)}"
    )


def _elsewhere(title: str, made: Any, cloud: Any, merged: Codes) -> None:
    """A model on another survey, with what the drift report says of it."""
    from sklearn.metrics import accuracy_score, f1_score

    from algorithms.classify._learning import drift

    label, given, data = _applied(made, cloud)
    number = np.searchsorted(made.classes, given)
    rows = list(drift.rows(made, data, number))
    known = np.isin(merged[label], merged[made.classes])
    true, said = merged[label[known]], merged[given[known]]
    codes = np.unique(true)
    f1 = f1_score(true, said, average=None, labels=codes, zero_division=0)
    unlike = [row["feature"] for row in rows if row["verdict"] == "unlike"]
    chance = made.probabilities(data).max(axis=1).mean()
    say(
        f"learning  {title:60} {100 * accuracy_score(true, said):5.2f} % where "
        f"{100 * chance:.1f} % are expected, F1 of {codes.tolist()} {_percents(f1)}; "
        f"{len(unlike)} of {len(rows)} features unlike, first {', '.join(unlike[:3]) or 'none'}; "
        f"outside {100 * drift.beyond(made, data).mean():.1f} %"
    )


def _applied(made: Any, cloud: Any) -> tuple[Codes, Codes, Any]:
    """Label and given class of each point, and its features."""
    data = _described(cloud, made.features)
    given = made.classes[made.probabilities(data).argmax(axis=1)].astype(np.int64)
    return cloud["classification"].astype(np.int64), given, data


def _described(cloud: Any, names: Any) -> Any:
    from algorithms.classify._learning.features import described

    return described(cloud, names)


def _model(clouds: list[Any], codes: tuple[int, ...]) -> Any:
    """A model of 15,000 points of each class of all clouds, as classify.train makes it."""
    from algorithms.classify._learning.features import usual

    names = [name for name in usual(clouds[0], RADII) if all(_has(c, name) for c in clouds)]
    each = [np.ones(len(cloud), bool) for cloud in clouds]
    return _learnt([_described(cloud, names) for cloud in clouds], clouds, each, codes, names)


def _learnt(
    described: Any,
    clouds: Any,
    some: Any,
    codes: tuple[int, ...],
    names: Any,
    block: float | None = 10.0,
    seed: int = 0,
) -> Any:
    """The model of some points of clouds whose features are given."""
    import dataclasses

    from algorithms.classify._learning import drift
    from algorithms.classify._learning.training import (
        Labelled,
        Settings,
        binned,
        folds_of,
        kept_back,
        temperature,
        trained,
    )
    from algorithms.classify.train import drawn
    from algorithms.shared.accuracy.blocks import blocks

    parts = []
    for cloud, features, own in zip(clouds, described, some, strict=True):
        label = np.where(own, cloud["classification"].astype(np.int64), -1)
        here = [code for code in codes if (label == code).any()]
        chosen, weight = drawn(cloud.xyz, label, here, 15_000 // len(clouds), seed)
        data = features[chosen]
        parts.append((data, np.searchsorted(codes, label[chosen]), weight, cloud.xyz[chosen, :2]))
    data, label, weight, xy = (np.concatenate(column) for column in zip(*parts, strict=True))
    points = Labelled(data, label, weight, blocks(xy, block).number)
    about = {"kind": "boosting", "classes": list(codes), "features": names, "density": 1.0}
    how = Settings("boosting", 50, False, seed, about)
    points = binned(points, how)
    made = trained(points, how)
    folds = folds_of(points.block, 2)
    heat = {"temperature": temperature(kept_back(points, folds, how)[0], points)}
    more = heat | drift.learnt(points, folds, len(codes))
    return dataclasses.replace(made, about={**made.about, **more})


def _has(cloud: Any, name: str) -> bool:
    from algorithms.classify._learning.features import usual

    return name in usual(cloud, RADII)


def _percents(values: Any) -> str:
    return " ".join(f"{100 * value:.1f}" for value in values)


def _seconds(work: Callable[[], object]) -> float:
    """Processor time of a call, after one that compiles and reads."""
    work()
    start = time.process_time()
    work()
    return time.process_time() - start
