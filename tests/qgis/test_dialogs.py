"""The dialogs of all tools: left as they are they send the defaults."""

from __future__ import annotations

import json
import re
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
from affine import Affine
from pyproj import CRS
from qgis_program import Qgis
from shapely.geometry import box

from toolbox import catalog
from toolbox.data import Raster, Vector
from toolbox.errors import ParameterError
from toolbox.qgis.model import from_qgis

SCRIPT = Path(__file__).with_name("dialogs.py")


def test_an_untouched_dialog_sends_the_defaults(qgis: Qgis, cloud: Path, tmp_path: Path) -> None:
    raster, features = tmp_path / "r.tif", tmp_path / "f.gpkg"
    place = Affine(10, 0, 500000, 0, -10, 4500060)
    Raster(np.ones((6, 6)), place, crs=CRS(32635)).save(raster)
    squares = gpd.GeoDataFrame({"a": [1]}, geometry=[box(0, 0, 5, 5)], crs=32635)
    Vector(squares).save(features)
    profile, designed = qgis.home / "profiles" / "default", tmp_path / "designed"
    designed.mkdir()
    done = qgis.python(SCRIPT, profile, cloud, raster, features, designed)
    found = re.search(r"(?m)^RESULT (.*)$", done.stdout)
    if found is None and "No module named 'processing'" in done.stderr:
        pytest.skip("the Processing plugin of QGIS is elsewhere; set QGIS_PYTHON")
    assert found, done.stderr[-2000:]
    tools = json.loads(found[1])
    assert tools.pop("settings page") == []
    assert sorted(tools) == catalog.ids()
    assert {tool: wrong for tool, wrong in tools.items() if wrong} == {}
    for path in designed.iterdir():
        with pytest.raises(ParameterError) as said:
            from_qgis(path.read_text("utf-8"), path.name)
        assert said.value.problems == {"outputs": "the model gives nothing"}, path
    assert len(list(designed.iterdir())) == len(tools)
