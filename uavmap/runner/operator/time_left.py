"""The done and the remaining part of a mission, as far as known.

The region's size is unknown before it is explored. So the share may fall when more of it is found,
and it is 100 % only when all vehicles are at home.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from missions.flight.state import State
from missions.flight.vehicle_state import Phase
from missions.mission.energy import LANDING_OVERHEAD_S

ALMOST: Final = 0.99
"""Maximum share that is shown before all vehicles are at home."""
_OUT = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.LOST)


@dataclass(frozen=True, slots=True)
class TimeLeft:
    """The known rest of a mission.

    Attributes:
        what: Name of the rest.
        of: Name of the whole to which `share` refers.
        share: Done part of that, 0 to 1.
        about_s: Mission time for the rest, s. Return paths begin at the vehicles' present places;
            battery swaps are not counted.

    >>> TimeLeft("40 m of search lanes", "the search lanes", 0.756, 130.0).text
    '75 % of the search lanes, about 2 min left for 40 m of search lanes'
    >>> TimeLeft().text
    ''
    """

    what: str = ""
    whole: str = ""
    share: float | None = None
    about_s: float | None = None

    @property
    def text(self) -> str:
        """All that is known, for a table and a page; empty where nothing is."""
        return f"{self.brief} for {self.what}" if self.about_s is not None else self.brief

    @property
    def brief(self) -> str:
        """Share and time, for a line."""
        parts = []
        if self.share is not None:
            parts.append(f"{int(100 * self.share)} % of {self.whole}")
        if self.about_s is not None:
            parts.append(f"{duration(self.about_s)} left")
        return ", ".join(parts)


def duration(seconds: float) -> str:
    """Return an estimated time as text.

    >>> [duration(s) for s in (2.0, 44.0, 100.0, 3500.0, 4300.0)]
    ['less than 10 s', 'about 40 s', 'about 2 min', 'about 58 min', 'about 1 h 12 min']
    """
    if seconds < 10.0:
        return "less than 10 s"
    if seconds < 55.0:
        return f"about {round(seconds, -1):.0f} s"
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"about {hours} h {minutes} min" if hours else f"about {minutes} min"


def time_left(state: State) -> TimeLeft:
    """Return the known rest, shared among all vehicles that fly."""
    if state.is_over:
        done = TimeLeft("nothing more to explore", "the mission", 1.0)
        return done if state.exploration_finished else TimeLeft()
    if state.exploration_finished:
        way_s = _return_s(state)
        what = "nothing more to explore" if way_s is None else "the return"
        return TimeLeft(what, "the mission", ALMOST, way_s)
    team = sum(v.phase not in _OUT and not v.called_home for v in state.vehicles.values())
    if state.recalled or not team:
        return TimeLeft()
    if state.setting.strategy.whole_box:
        left = _survey_left(state, team)
    else:
        left = _search_left(state, team) or _region_left(state, team)
    way_s = _return_s(state)
    if left.about_s is None or way_s is None:
        return left
    return replace(left, what=f"{left.what} and the return", about_s=left.about_s + way_s)


def _return_s(state: State) -> float | None:
    """Return the time until the last vehicle is down, s; None if none of ours is in the air."""
    energy = state.setting.energy
    ways = [
        energy.leg_s(vehicle.position.distance_to(vehicle.pad))
        + energy.descent_s(max(vehicle.height_m, 0.0))
        + LANDING_OVERHEAD_S
        for vehicle in state.vehicles.values()
        if vehicle.phase is Phase.AIRBORNE and not vehicle.landed
    ]
    return max(ways, default=None)


def _share(done: float, left: float) -> float | None:
    whole = done + left
    return min(max(done, 0.0) / whole, ALMOST) if whole > 0.0 else None


def _lanes_left_m(state: State) -> float:
    """Return the length of lanes that no judged frame shows, m."""
    left_m = sum(a.distance_to(b) for a, b in state.unreachable_lanes)
    for vehicle in state.vehicles.values():
        lanes_m = [a.distance_to(b) for a, b in vehicle.lanes]
        if lanes_m and vehicle.on_lane:  # the first is shortened when its end is reached
            lanes_m[0] -= min(max(vehicle.lane_seen_m, default=0.0), lanes_m[0])
        left_m += sum(lanes_m)
    return left_m


def _search_left(state: State, team: int) -> TimeLeft | None:
    setting = state.setting
    if state.tree is not None:
        return None
    left_m = _lanes_left_m(state)
    if setting.strategy.patches and not left_m:  # vehicles fly straight to the rest of the lanes
        left = len(setting.strategy.open_cells(state))
        cells = "1 cell" if left == 1 else f"{left} cells"
        return TimeLeft(
            f"{cells} to decide", "", None, left * setting.strategy.cell_s(setting) / team or None
        )
    whole_m = sum(a.distance_to(b) for a, b in setting.lanes)
    return TimeLeft(
        f"{left_m:.0f} m of search lanes",
        "the search lanes",
        _share(whole_m - left_m, left_m),
        left_m / setting.energy.speed_m_s / team,
    )


def _region_left(state: State, team: int) -> TimeLeft:
    assert state.tree is not None
    vertices = state.tree.vertices
    left = sum(
        not vertex.observed and cell not in state.abandoned and cell not in state.skipped
        for cell, vertex in vertices.items()
    )
    looked = sum(vertex.observed for vertex in vertices.values())
    cells = "1 known cell" if left == 1 else f"{left} known cells"
    about_s = left * state.setting.strategy.cell_s(state.setting) / team
    return TimeLeft(
        f"{cells} to observe", "the known region", _share(looked, left), about_s or None
    )


def _survey_left(state: State, team: int) -> TimeLeft:
    cells = state.setting.box_cells
    left = sum(state.belief.verdict(cell) is None for cell in cells)
    about_s = state.setting.strategy.rest_s(state, _lanes_left_m(state), left, team)
    what = "1 cell of the box" if left == 1 else f"{left} cells of the box"
    return TimeLeft(what, "the box", _share(len(cells) - left, left), about_s or None)
