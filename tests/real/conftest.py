"""Real autopilots of this computer: `make test-real ARDUCOPTER=path PX4=path`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.real.scenario import VARIABLES


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Fly each scenario with every autopilot that has a program."""
    if "autopilot" in metafunc.fixturenames:
        there = [name for name, variable in VARIABLES.items() if os.environ.get(variable)]
        metafunc.parametrize("autopilot", there or [None])


@pytest.fixture
def program(autopilot: str | None) -> Path:
    if autopilot is None:
        pytest.skip("no real autopilot: make test-real ARDUCOPTER=path PX4=path")
    path = Path(os.environ[VARIABLES[autopilot]])
    assert path.is_file(), f"{path} is no program"
    return path
