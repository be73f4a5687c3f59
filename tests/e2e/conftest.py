"""Flights that several tests look at; each is flown once, in a process of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.rig import Finished, mission, uavmap


@dataclass(frozen=True, slots=True)
class Flight:
    done: Finished
    folder: Path

    @property
    def summary(self) -> dict[str, Any]:
        return self.done.summary


def _flown(tmp: pytest.TempPathFactory, name: str) -> Flight:
    folder = tmp.mktemp(name) / "out"
    done = uavmap("fly", mission(name), "--sim", "--json", "--out", folder)
    return Flight(done, folder)


def _flight(name: str) -> Any:
    @pytest.fixture(scope="session", name=name)
    def flown(tmp_path_factory: pytest.TempPathFactory) -> Flight:
        return _flown(tmp_path_factory, name)

    return flown


tiny, pair, drift, speck = map(_flight, ("tiny", "pair", "drift", "speck"))
