"""Texts of the dialogs in the language of QGIS, or in that which TOOLBOX_LANG names.

The plugin brings one file of texts along for each language, made from the catalogues of the
toolbox; what has no translation stays English.
"""

from __future__ import annotations

import functools
import json
import os
from pathlib import Path

from qgis.core import QgsApplication

HERE = Path(__file__).parent
VARIABLE = "TOOLBOX_LANG"


@functools.cache
def chosen() -> str:
    """The two letters of the language; "en" where the plugin has no texts of it."""
    said = os.environ.get(VARIABLE) or str(QgsApplication.locale())
    code = said.replace("-", "_").partition("_")[0].partition(".")[0].lower()
    return code if code.isalpha() and (HERE / f"texts.{code}.json").is_file() else "en"


@functools.cache
def _texts() -> dict[str, str]:
    try:
        return dict(json.loads((HERE / f"texts.{chosen()}.json").read_text(encoding="utf-8")))
    except (OSError, ValueError):  # English
        return {}


def text(english: str) -> str:
    """A text in the language that is chosen."""
    return _texts().get(english, english)


def file(name: str, ending: str) -> Path:
    """A file of the plugin in the language that is chosen, or else in English."""
    own = HERE / f"{name}.{chosen()}{ending}"
    return own if own.is_file() else HERE / f"{name}{ending}"
