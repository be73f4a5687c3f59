"""The referee of real autopilots: the truth of their simulations, and their ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from missions.geo.grid import Grid
from missions.mission.places import homes
from missions.mission.schema import Mission
from missions.units import Cell, GridPoint, LatLon
from tests import referee
from tests.e2e.rig import roi_cells
from tests.real.autopilot import Truth
from tests.support.claims import bounds_of
from uavmap.output.facts.score import Score, score, true_roi

IN_THE_AIR_M: Final = 0.5
HONEST: Final = ("away", "lie", "owner", "traceback")
"""Kinds of faults that no scenario may end with; the scenario checks the others by itself."""


@dataclass(slots=True)
class Referee:
    """The referee of a scenario; its vehicles count from 0."""

    mission: Mission
    judge: referee.Referee = field(init=False)
    _grid: Grid = field(init=False)

    def __post_init__(self) -> None:
        self._grid = grid = Grid.at(self.mission.home, self.mission.grid.cell_m)
        pads = {n: grid.fixed(place) for n, place in enumerate(homes(self.mission), start=1)}
        self.judge = referee.Referee(bounds_of(self.mission, grid, pads))

    def watch(self, number: int, truth: Truth) -> None:
        """Record the position of an aircraft now, by the computer's clock, which all share."""
        up_m = truth.amsl_m - self.mission.start.amsl_m
        sample = referee.Sample(
            truth.arrived_s, self._grid.fixed(truth.position), up_m, up_m > IN_THE_AIR_M,
            down_m_s=truth.velocity_m_s[2],
        )  # fmt: skip
        self.judge.see(number + 1, sample)

    def _now(self, number: int) -> referee.Sample | None:
        memory = self.judge.memories.get(number + 1)
        return None if memory is None else memory.now

    def up_m(self, number: int) -> float:
        now = self._now(number)
        return 0.0 if now is None else now.up_m

    def position(self, number: int) -> LatLon:
        now = self._now(number)
        return self.mission.home if now is None else self._grid.position(now.place)

    @property
    def has_flown(self) -> bool:
        return any(memory.highest_m >= 1.0 for memory in self.judge.memories.values())

    @property
    def breaches(self) -> int:
        return sum(kind == "breach" for kind, _ in self.judge.found)

    def dishonest(
        self, code: int, said: Sequence[str], summary: Mapping[str, Any], owners: str
    ) -> str:
        """Return the differences between the truth and the report of `uavmap` at its end."""
        faults = [("traceback", line) for line in said if "Traceback" in line]
        faults += [("traceback", f"exit {code}")] if code not in (0, 2, 3, 4, 5) else []
        # a flight that was killed before its results has no summary
        completed = bool(summary.get("completed", code == 0))
        before = len(self.judge.found)
        self.judge.conclude(
            referee.ProductReport(0.0, code=code, completed=completed, owners=owners, faults=faults)
        )
        return "; ".join(text for kind, text in self.judge.found[before:] if kind in HONEST)


def scored(folder: Path, mission: Mission) -> Score | None:
    """The map of a flight against the ground that its camera rendered; None without a map."""
    if not (folder / "map.geojson").exists():
        return None
    grid = Grid.at(
        mission.home, mission.grid.cell_m, mission.drift.speed_m_s, mission.drift.toward_deg
    )
    cells = [Cell(*cell) for cell in roi_cells(folder)]
    return score(cells, true_roi(mission, grid), grid, ())


def middle_of_region(mission: Mission) -> LatLon:
    grid = Grid.at(mission.home, mission.grid.cell_m)
    middle = true_roi(mission, grid).centroid
    return grid.position(GridPoint(middle.x, middle.y))
