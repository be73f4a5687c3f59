"""What really happened, by the simulations' own truth, held against what `uavmap` said."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from shapely.geometry import Point, Polygon

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.mission.places import homes
from missions.mission.schema import Mission, positions
from missions.units import Cell, GridPoint, LatLon
from tests.e2e.rig import ROI_STATES
from tests.real.autopilot import Truth
from uavmap.output.facts.score import Score, score, true_roi

IN_THE_AIR_M: Final = 0.5
NEAR_M: Final = 5.0
"""Distance from its pad within which an aircraft is at home."""
HARD_M_S: Final = 2.5
"""Speed towards the ground at which it strikes."""
_SAME_TIME_S: Final = 0.3


@dataclass(slots=True)
class Track:
    truth: Truth | None = None
    up_m: float = 0.0
    highest_m: float = 0.0
    place: tuple[float, float] = (0.0, 0.0)
    outside: bool = False
    struck: bool = False


@dataclass(slots=True)
class Referee:
    mission: Mission
    tracks: list[Track]
    breaches: int = 0
    least_m: float = math.inf
    _plane: LocalPlane = field(init=False)
    _fence: Polygon = field(init=False)
    _pads: list[tuple[float, float]] = field(init=False)

    def __post_init__(self) -> None:
        self._plane = LocalPlane(self.mission.home)
        to_plane = self._plane.to_plane
        self._fence = Polygon(
            [to_plane(p) for p in positions(self.mission.fence.polygon)],
            [[to_plane(p) for p in positions(hole)] for hole in self.mission.fence.holes],
        )
        self._pads = [to_plane(place) for place in homes(self.mission)]

    def watch(self, number: int, truth: Truth) -> None:
        """See where an aircraft (from 0) is now."""
        track = self.tracks[number]
        up_m = truth.amsl_m - self.mission.start.amsl_m
        if track.up_m > IN_THE_AIR_M >= up_m and truth.velocity_m_s[2] > HARD_M_S:
            track.struck = True
        track.truth, track.up_m = truth, up_m
        track.place = self._plane.to_plane(truth.position)
        track.highest_m = max(track.highest_m, up_m)
        if up_m <= IN_THE_AIR_M:
            return
        outside = not self._fence.contains(Point(track.place))
        self.breaches += outside and not track.outside
        track.outside = outside
        flying = [one for one in self.tracks if one.up_m > IN_THE_AIR_M and one.truth is not None]
        for a, b in itertools.combinations(flying, 2):
            assert a.truth is not None
            assert b.truth is not None
            if abs(a.truth.arrived_s - b.truth.arrived_s) < _SAME_TIME_S:
                apart_m = math.hypot(math.dist(a.place, b.place), a.up_m - b.up_m)
                self.least_m = min(self.least_m, apart_m)

    def from_pad_m(self, number: int) -> float:
        """How far an aircraft is from its pad, over ground."""
        return math.dist(self.tracks[number].place, self._pads[number])

    @property
    def in_the_air(self) -> list[int]:
        """The aircraft that fly, from 1."""
        return [k for k, track in enumerate(self.tracks, start=1) if track.up_m > IN_THE_AIR_M]

    @property
    def all_at_home(self) -> bool:
        return not self.in_the_air and all(
            self.from_pad_m(k) <= NEAR_M for k in range(len(self.tracks))
        )

    def dishonest(self, code: int, said: Sequence[str], summary: Mapping[str, Any]) -> str:
        """What `uavmap` said at its end that is not so; empty for nothing."""
        if code in (0, 3, 5) and not self.all_at_home:
            away = [f"{self.from_pad_m(k):.1f} m" for k in range(len(self.tracks))]
            return f"exit {code}, and not all are at home: {', '.join(away)} from their pads"
        if code == 0 and summary and not summary["completed"]:
            return "exit 0, and the summary says that it is not complete"
        if code == 3 and summary.get("completed"):
            return "exit 3, and the summary says that it is complete"
        if code == 4 and self.all_at_home and not any(track.struck for track in self.tracks):
            return "exit 4, and all are at home"
        if code not in (0, 2, 3, 4, 5):
            return f"exit {code}"
        broken = [line for line in said if "Traceback" in line]
        return broken[0] if broken else ""


def scored(folder: Path, mission: Mission) -> Score | None:
    """The map of a flight against the ground that its camera rendered; None without a map."""
    path = folder / "map.geojson"
    if not path.exists():
        return None
    grid = Grid.at(
        mission.home, mission.grid.cell_m, mission.drift.speed_m_s, mission.drift.toward_deg
    )
    cells = [
        Cell(feature["properties"]["column"], feature["properties"]["row"])
        for feature in json.loads(path.read_text("utf-8"))["features"]
        if feature["properties"]["kind"] == "cell" and feature["properties"]["state"] in ROI_STATES
    ]
    return score(cells, true_roi(mission, grid), grid, ())


def middle_of_region(mission: Mission) -> LatLon:
    grid = Grid.at(mission.home, mission.grid.cell_m)
    middle = true_roi(mission, grid).centroid
    return grid.position(GridPoint(middle.x, middle.y))
