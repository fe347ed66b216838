"""Draws the pictures of right and wrong in docs/choose: python docs/make_choices.py."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

import toolbox

IMAGES = Path(__file__).parent / "images"
WIDTH, HEAD, COLOURS = 360, 26, 96  # pixels of one picture and its heading; colours of a file
Panel = tuple[str, str, dict[str, Any]]  # heading, tool, values

TOWN = {"kind": "town", "size": 120, "seed": 5, "points": "town.laz"}


def filters() -> list[Panel]:
    """The terrain under one right and two wrong choices."""
    given = {"points": "town.laz"}
    wrong = given | {"max_building_size": 10}
    toolbox.run("ground.classify", given | {"classified": "right.laz"})
    toolbox.run("ground.ptd", wrong | {"classified": "roofs.laz"})
    toolbox.run("ground.csf", given | {"class_threshold": 2.0, "classified": "shrubs.laz"})
    says = {
        "right": "right: ground.classify",
        "roofs": "wrong: ptd, max_building_size 10",
        "shrubs": "wrong: csf, class_threshold 2",
    }
    shaded = {"classes": 2, "cell": 0.5}
    return [(text, "surface.grid", shaded | {"points": f"{n}.laz"}) for n, text in says.items()]


def methods() -> list[Panel]:
    """A terrain model by one right and two wrong methods."""
    given = {"points": "town.laz", "cell": 0.5}
    ground = given | {"classes": 2}
    return [
        ("right: linear, class 2", "surface.grid", ground),
        ("wrong: max of all points", "surface.grid", given | {"method": "max"}),
        ("wrong: nearest, class 2", "surface.grid", ground | {"method": "nearest"}),
    ]


def draw(name: str, panels: list[Panel]) -> None:
    """Run the tools, and put their pictures side by side under headings."""
    pictures = []
    for number, (text, id, values) in enumerate(panels):
        path = f"{name}{number}.png"
        toolbox.run(id, values | {"picture": path})
        with Image.open(path) as image:
            size = (WIDTH, round(image.height * WIDTH / image.width))
            small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        pictures.append((text, small))
    tall = max(small.height for _, small in pictures)
    sheet = Image.new("RGB", (WIDTH * len(pictures), tall + HEAD), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for place, (text, small) in enumerate(pictures):
        sheet.paste(small, (place * WIDTH, HEAD))
        pen.text((place * WIDTH + 8, 4), text, "black", font)
    sheet.quantize(COLOURS).save(IMAGES / f"{name}.png", optimize=True)


def main() -> None:
    """Draw both."""
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        toolbox.run("samples.scene", TOWN)
        draw("choose-ground-filter", filters())
        draw("choose-gridding-method", methods())


if __name__ == "__main__":
    main()
