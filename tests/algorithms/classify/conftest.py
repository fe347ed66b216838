"""What is trained once, for the tests of training and of applying."""

from __future__ import annotations

from typing import Any

import pytest

from algorithms.classify.som import ClassifySom
from algorithms.classify.train import ClassifyTrain
from tests.scenes.parks import NAMES, QUICK, park, yard


@pytest.fixture(scope="session")
def made() -> Any:
    return ClassifyTrain(points=yard(), features=NAMES, **QUICK).run()


@pytest.fixture(scope="session")
def trained() -> ClassifySom.Outputs:
    return ClassifySom(points=park()).run()
