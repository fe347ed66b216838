"""The conda recipe asks for what pyproject.toml asks for, and versions are the same everywhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import yaml

import toolbox

ROOT = Path(__file__).resolve().parents[1]
OTHERWISE = {"matplotlib": "matplotlib-base"}  # names of conda-forge
RECIPE = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_the_recipe_needs_what_the_project_needs() -> None:
    wanted = [f"python {PROJECT['requires-python']}"]
    for need in PROJECT["dependencies"]:
        name, version = re.fullmatch(r"([\w-]+)(.*)", need).groups()  # type: ignore[union-attr]
        wanted.append(f"{OTHERWISE.get(name, name)} {version}")
    assert RECIPE["requirements"]["run"] == wanted


def test_versions_are_the_same() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == RECIPE["context"]["version"] == toolbox.__version__


def test_the_image_copies_what_the_wheel_needs() -> None:
    copied = set(re.findall(r"^COPY (.*) \S+$", (ROOT / "Dockerfile").read_text("utf-8"), re.M))
    named = {name for line in copied if "--from" not in line for name in line.split()}
    assert {
        "toolbox",
        "algorithms",
        "metadata",
        "pyproject.toml",
        "README.md",
        "CHANGELOG.md",
    } <= named
    assert all((ROOT / name).exists() for name in named)
