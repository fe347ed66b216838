"""Makes the documentation site: ``make docs``. Why Sphinx: docs/decisions/0012-site.md."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import toolbox

sys.path.append(str(Path(__file__).parent / "_site"))

project = "lidar-toolbox"
author = "The lidar-toolbox developers"
copyright = author  # Sphinx has no other name for it
version = release = toolbox.__version__

extensions = ["myst_parser", "sphinx_copybutton", "diagrams"]
root_doc = "index"
exclude_patterns = ["README.md", "_site"]  # README.md is for those who read the folder itself
myst_heading_anchors = 3  # links such as page.md#a-heading
myst_fence_as_directive = ["mermaid"]
nitpicky = True  # with -W, a link that leads nowhere ends the build

html_theme = "furo"
html_title = "lidar-toolbox"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_copy_source = False
html_show_sphinx = False

linkcheck_timeout = 20
linkcheck_retries = 2


def _language(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object) -> None:
    """Say in which language a page is, so that it is read aloud in that one."""
    if page.startswith("tr/"):
        context["language"] = "tr"


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("html-page-context", _language)
