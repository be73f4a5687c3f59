"""Missions over uneven ground, for tests: slopes and hills as lattices in the text."""

from __future__ import annotations

import math

import numpy as np

from missions.geo.terrain import Heights, encoded
from missions.mission.checks import parse_mission
from missions.mission.schema import Mission
from missions.mission.sections import Lattice, TerrainSection

SIDE_M = 240.0
STEP_M = 4.0


def slope(percent: float, toward_deg: float) -> Heights:
    """Return heights that rise towards a bearing of the grid, 0 at the start."""
    east, north = _points()
    toward = math.radians(toward_deg)
    return percent / 100.0 * (east * math.sin(toward) + north * math.cos(toward))


def hills(seed: int, high_m: float, long_m: float = 90.0) -> Heights:
    rng = np.random.default_rng(seed)
    east, north = _points()
    heights = np.zeros_like(east)
    for length_m in long_m * np.geomspace(1.0, 2.5, 5):
        bearing, phase = rng.uniform(0.0, math.tau, 2)
        along = east * math.sin(bearing) + north * math.cos(bearing)
        heights += high_m / 10.0 * np.sin(math.tau * along / length_m + phase)
    middle = heights.shape[0] // 2
    return heights - heights[middle, middle]


def _points() -> tuple[Heights, Heights]:
    steps = np.arange(-SIDE_M, SIDE_M + STEP_M / 2.0, STEP_M)
    east, north = np.meshgrid(steps, steps)
    return east, north


def lattice(heights: Heights) -> Lattice:
    rows, columns = heights.shape
    return Lattice(
        west_m=-SIDE_M, south_m=-SIDE_M, step_m=STEP_M, columns=columns, rows=rows,
        heights=encoded(heights),
    )  # fmt: skip


def over(mission: Mission, heights: Heights, above: str = "ground") -> Mission:
    """Return a mission over such ground; it is not checked."""
    return mission.model_copy(
        update={
            "terrain": TerrainSection(dem=lattice(heights)),
            "flight": mission.flight.model_copy(update={"height_above": above}),
        }
    )


def text_over(text: str, heights: Heights, above: str = "ground") -> str:
    table = lattice(heights)
    inner = ", ".join(
        f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value}"
        for key, value in table.model_dump().items()
    )
    with_flight = text.replace("[flight]", f'[flight]\nheight_above = "{above}"', 1)
    return f"{with_flight}\n[terrain]\ndem = {{{inner}}}\n"


def checked(text: str) -> Mission:
    return parse_mission(text, "hills.toml")
