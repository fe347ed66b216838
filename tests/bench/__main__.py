"""Run the measurements that are named, or all; options go to the one before them."""

from __future__ import annotations

import itertools
import sys

from tests.bench.accuracy import accuracy, accuracy_fields
from tests.bench.buildings import buildings
from tests.bench.chains import chains
from tests.bench.corners import corners
from tests.bench.corridor import corridor
from tests.bench.corridor_presets import corridor_presets
from tests.bench.corridor_real import corridor_real
from tests.bench.corridor_settings import corridor_settings
from tests.bench.facades import facades
from tests.bench.figures import figures, outlines, real_fronts
from tests.bench.files import copc, damaged, memory, reading, reprojecting, startup
from tests.bench.fingerprints import fingerprints
from tests.bench.front_stability import front_stability
from tests.bench.gridding import gridding
from tests.bench.ground import (
    cloth,
    filters,
    grounds,
    halos,
    hillsides,
    isprs,
    low_noise,
    surveys,
    terrain,
)
from tests.bench.house_fronts import house_fronts
from tests.bench.learning import (
    learning,
    learning_drift,
    learning_elsewhere,
    learning_lines,
    learning_speed,
)
from tests.bench.long_lines import long_lines
from tests.bench.metamorphic import metamorphic
from tests.bench.path import path
from tests.bench.remote import remote
from tests.bench.roundtrip import roundtrip
from tests.bench.scikit import scikit
from tests.bench.server import server
from tests.bench.shorelines import shorelines, water_levels, waters
from tests.bench.speed import speed
from tests.bench.structures import structures
from tests.bench.suggesting import suggesting
from tests.bench.walls import walls

ALL = (
    accuracy,
    accuracy_fields,
    startup,
    reading,
    copc,
    reprojecting,
    remote,
    memory,
    isprs,
    filters,
    surveys,
    grounds,
    hillsides,
    low_noise,
    halos,
    cloth,
    terrain,
    damaged,
    roundtrip,
    scikit,
    server,
    speed,
    chains,
    structures,
    buildings,
    corners,
    walls,
    gridding,
    shorelines,
    water_levels,
    waters,
    corridor,
    corridor_presets,
    corridor_real,
    corridor_settings,
    learning,
    learning_drift,
    learning_elsewhere,
    learning_lines,
    learning_speed,
    suggesting,
    long_lines,
    facades,
    front_stability,
    house_fronts,
    fingerprints,
    metamorphic,
    path,
    real_fronts,
    outlines,
    figures,
)
WITH_OPTIONS = (
    accuracy_fields,
    chains,
    grounds,
    hillsides,
    corridor_presets,
    corridor_real,
    corridor_settings,
    figures,
    front_stability,
    house_fronts,
    metamorphic,
    suggesting,
    waters,
)
BENCHES = {b.__name__: b for b in ALL}

names = list(itertools.takewhile(lambda word: not word.startswith("-"), sys.argv[1:]))
options = sys.argv[1 + len(names) :]
if unknown := [name for name in names if name not in BENCHES]:
    sys.exit(f"no measurement called {', '.join(unknown)}; there are {', '.join(BENCHES)}")
if options and names not in ([bench.__name__] for bench in WITH_OPTIONS):
    able = " or ".join(bench.__name__ for bench in WITH_OPTIONS)
    sys.exit(f"{options[0]}: only {able}, alone, has options")
for name in names or BENCHES:
    BENCHES[name](*options)
