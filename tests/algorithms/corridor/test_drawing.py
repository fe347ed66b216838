"""Pictures of reports in SVG."""

from __future__ import annotations

import base64
import io
import itertools
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from algorithms.corridor._clearance.drawing import DOT, Drawing, _ticks


def drawing() -> Drawing:
    return Drawing(np.array([0.0, 100.0]), np.array([10.0, 120.0]), (200, 100), ("m", "a < b"))


def test_points_are_dots_in_the_colours_of_their_kinds_and_the_first_kind_is_on_top() -> None:
    made = drawing()
    x, y = np.array([5.0, 5.0, 0.01, 11.0]), np.array([110.0, 110.0, 119.99, 110.0])
    made.points(x, y, np.array([1, 0, 1, 0]), ["#ff0000", "#0000ff"], 1.0)
    picture = Image.open(io.BytesIO(base64.b64decode(made.shapes[0]["png"])))
    assert picture.convert("RGB").getcolors()[0][1] == (255, 255, 255), "dots in a PDF turn grey"
    png = re.findall(rb"data:image/png;base64,([^\"]+)", made.svg())
    with Image.open(io.BytesIO(base64.b64decode(png[0]))) as picture:
        pixels = np.asarray(picture.convert("RGBA"))
    assert pixels.shape == (100 // DOT, 200 // DOT, 4)
    assert pixels[50 // DOT, 100 // DOT].tolist() == [255, 0, 0, 255]
    assert pixels[0, 0].tolist() == [0, 0, 255, 255]
    assert np.count_nonzero(pixels[..., 3]) == 2  # the last is outside


def test_what_is_drawn_is_where_it_belongs_and_texts_are_escaped() -> None:
    made = drawing()
    made.curve(np.array([0.0, 10.0]), np.array([100.0, 120.0]), "#000000", 1.0, "6 3")
    made.mark(5.0, 105.0, "#ff0000")
    made.text(5.0, 105.0, "<1>")
    made.key("mark", "R & D", "#ff0000")
    root = ElementTree.fromstring(made.svg())
    name = "{http://www.w3.org/2000/svg}"
    assert root.find(f".//{name}polyline").get("points") == "0.0,100.0 200.0,0.0"  # type: ignore[union-attr]
    (circle, *_) = root.iter(f"{name}circle")
    assert (circle.get("cx"), circle.get("cy")) == ("100.0", "75.0")
    texts = [text.text for text in root.iter(f"{name}text")]
    assert {"<1>", "R & D", "m", "a < b", "110"} <= set(texts)
    assert texts.count("<1>") == 2, "a halo of its own, below, as PDF knows no paint-order"


@pytest.mark.parametrize(
    ("low", "high", "pixels", "expected"),
    [
        (0.0, 10.0, 400, [0, 2, 4, 6, 8, 10]),
        (-3.0, 290.0, 880, [0, 50, 100, 150, 200, 250]),
        (29.96, 30.04, 350, [29.96, 29.98, 30.0, 30.02, 30.04]),
        (0.0, 1.0, 20, [0.0, 0.5, 1.0]),
    ],
)
def test_ticks_are_round_numbers(
    low: float, high: float, pixels: float, expected: list[float]
) -> None:
    assert _ticks(low, high, pixels).tolist() == pytest.approx(expected)


def boxes(svg: bytes) -> dict[str, tuple[float, float, float, float]]:
    """Where the labels of a drawing stand: left, top, right, bottom, in pixels."""
    name = "{http://www.w3.org/2000/svg}"
    found = {}
    for text in ElementTree.fromstring(svg).iter(f"{name}text"):
        if text.get("class") == "label":
            left, base = float(text.get("x", "")), float(text.get("y", ""))
            found[str(text.text)] = (left, base - 8, left + 6 * len(str(text.text)), base)
    return found


def test_texts_do_not_lie_on_each_other_and_stay_in_the_window() -> None:
    """Numbers of trees of one clump lay on each other; those of its edge were cut."""
    made = drawing()
    places = [(9.9, 119.9), (9.9, 119.8), *[(5.0 + 0.1 * k, 110.0) for k in range(12)]]
    for number, (x, y) in enumerate(places, start=101):
        made.text(x, y, str(number))
    svg = made.svg()
    found = list(boxes(svg).values())
    assert len(found) == len(places)
    for one, other in itertools.combinations(found, 2):
        across = max(one[0], other[0]) - min(one[2], other[2])
        up = max(one[1], other[1]) - min(one[3], other[3])
        assert max(across, up) >= 4 - 0.11, "rounded to tenths"
    assert all(b[0] >= 0 and b[1] >= 0 and b[2] <= 200 and b[3] <= 100 for b in found)
    far = re.findall(rb'class="leader" d="M([0-9.]+) ([0-9.]+)L', svg)
    assert 0 < len(far) < len(places), "a line leads from a place to its text where that is far"


@pytest.mark.parametrize("place", [(0.0, 100.0), (5.0, 110.0), (10.0, 120.0)])
def test_a_text_without_room_is_left_out(place: tuple[float, float]) -> None:
    """Where no place was free, numbers were laid on each other."""
    made = drawing()
    for number in range(101, 301):
        made.text(*place, str(number))
    found = list(boxes(made.svg()).values())
    assert 20 < len(found) < 200
    for one, other in itertools.combinations(found, 2):
        across = max(one[0], other[0]) - min(one[2], other[2])
        assert max(across, max(one[1], other[1]) - min(one[3], other[3])) > 3.8


def test_a_number_stands_on_no_mark() -> None:
    """Numbers of objects lay on the marks of others beside them."""
    made = drawing()
    for x, y in ((5.0, 110.0), (5.3, 111.6)):
        made.mark(x, y, "#d40000")
    made.text(5.0, 110.0, "1")
    ((left, top, right, bottom),) = boxes(made.svg()).values()
    for x, y in ((100, 50), (106, 42)):
        assert right <= x - 3 or left >= x + 3 or bottom <= y - 3 or top >= y + 3


def test_a_text_alone_stands_right_above_its_place() -> None:
    made = drawing()
    made.text(5.0, 110.0, "1")
    assert boxes(made.svg()) == {"1": (104.0, 38.0, 110.0, 46.0)}
    assert b'class="leader"' not in made.svg()
