"""Flights that several tests share; each is flown once, in a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.e2e.rig import Flight, fly


def _flight(name: str, *more: str) -> Any:
    @pytest.fixture(scope="session")
    def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
        return fly(name, tmp_path_factory.mktemp(name) / "out", *more)

    return flight


tiny, pair, drift, speck = map(_flight, ("tiny", "pair", "drift", "speck"))
tiny_passed, speck_passed = (_flight(name, "--strategy", "swath") for name in ("tiny", "speck"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "out"
