"""Runs the examples of docs/examples.yaml, and makes the gallery of their pictures: make gallery.

It takes some five minutes the first time, when loops are compiled. With ids of tools as arguments
only these are drawn; what they read is made all the same.
"""

from __future__ import annotations

import os
import sys
import tempfile
from itertools import groupby
from pathlib import Path

from PIL import Image

import toolbox
from toolbox import catalog
from toolbox.declare.fields import Spec
from toolbox.reference import PICTURES, ROOT, examples

WIDTH, QUALITY = 720, 50  # of a picture: enough to see what it is, some 30 kB
HEAD = """# Gallery

What each tool makes of its example, which is on its page. `make gallery` runs all examples
and draws these pictures. Tools that write nothing but tables or an index of files have none, nor
have those that need an image or waveforms, which no sample survey has.
"""


def run_all(drawn: set[str]) -> None:
    """Run all examples, each in the folder where those before have left their results."""
    for id, runs in examples().items():
        for number, values in enumerate(runs):
            if values.get("$run") is False:
                continue
            given = {k: v for k, v in values.items() if not k.startswith("$")}
            picture = Path("picture.png")
            wanted = number == 0 and id in drawn
            toolbox.run(id, given | ({"picture": str(picture)} if wanted else {}), overwrite=True)
            if wanted and picture.exists():  # a table alone is not drawn, with a warning
                shrink(picture, PICTURES / f"{id}.webp")
                picture.unlink()


def shrink(picture: Path, to: Path, width: int = WIDTH) -> None:
    """Write a small picture."""
    with Image.open(picture) as image:
        rgb = image.convert("RGB")
        size = (width, round(rgb.height * width / rgb.width))
        small = rgb.resize(size, Image.Resampling.LANCZOS)
        small.save(to, quality=QUALITY, method=6)


def gallery(specs: list[Spec]) -> str:
    """The page with all pictures, by group."""
    parts = [HEAD]
    for group, members in groupby(specs, lambda spec: spec.group):
        parts.append(f"## {group}\n")
        for spec in members:
            text = f"**{spec.title}**, [`{spec.id}`](tools/{spec.id}.md). {spec.summary}.\n"
            picture = f"![{spec.title}](images/tools/{spec.id}.webp)\n"
            parts.append(f"{text}\n{picture}" if (PICTURES / f"{spec.id}.webp").exists() else text)
    return "\n".join(parts)


def main(ids: list[str]) -> None:
    """Draw the pictures of these tools, or of all, and write the page."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        run_all(set(ids) or set(catalog.own_ids()))
        os.chdir(ROOT)
    for path in PICTURES.glob("*.webp"):
        if path.stem not in catalog.own_ids():
            path.unlink()
    specs = [catalog.load(id) for id in catalog.own_ids()]
    (ROOT / "docs" / "gallery.md").write_text(gallery(specs), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
