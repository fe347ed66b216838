"""Folders of the package: a package of others that has its name is told."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from toolbox import catalog, places
from toolbox.errors import DataError


def test_a_package_that_has_the_name_of_ours_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As a folder of the own research, where Python is started."""
    theirs = SimpleNamespace(origin=str(tmp_path / "algorithms" / "__init__.py"))
    monkeypatch.setattr(places, "find_spec", lambda name: theirs)
    with pytest.raises(DataError, match=r"algorithms hides the package 'algorithms'.*rename it"):
        catalog.own_ids()
