"""Random small missions for the fake fleet: a fence with a hole, a box, batteries, a true ROI."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import missions.lab.strategies  # noqa: F401 - the strategies of papers register themselves
from missions.errors import MissionFileError
from missions.events import Event
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.team.members import facts_of, with_map
from missions.geo.grid import Grid
from missions.lab.arena.roi import eden
from missions.mission.checks import parse_mission
from missions.mission.schema import Mission
from missions.units import Cell, GridPoint, LatLon

START = LatLon(48.0, 11.0)
CELL_M = 4.0

UNKIND_STRATEGIES = (
    *("rdfs", "greedy", "horizon", "hungarian"),
    *("swath", "swath", "swath", "swath", "survey"),
)
"""Strategies of unkind worlds: half of them fly without stopping."""

FAULTS = {
    "gps": "",
    "gps_glitch": "metres = 5.0",
    "gps_drift": "m_s = 2.0",
    "battery_sag": "volts = 4.0",
    "battery_cell": "",
    "compass": "deg = 20.0",
    "wind_gust": "m_s = 5.0",
    "motor": "share = 0.5",
    "camera_stall": "",
    "camera_black": "",
    "camera_corrupt": "",
    "reject": "command = 192",
    "rc": "",
    "link": "loss = 0.2",
    "companion_reboot": "",
}
"""An example of each kind of `[[sim.faults]]`: its value, or empty for a kind without values."""

Points = Collection[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Scenario:
    mission: Mission
    roi: frozenset[Cell]


def ring(grid: Grid, points: Points) -> str:
    """Return the TOML of a ring, from ground metres around the start."""
    places = [grid.position(GridPoint(*point)) for point in points]
    return "[" + ", ".join(f"[{p.lat_deg:.9f}, {p.lon_deg:.9f}]" for p in places) + "]"


def square(east_m: float, north_m: float, width_m: float, depth_m: float) -> Points:
    """Return the corners of a rectangle from its south-west corner."""
    return [
        (east_m, north_m),
        (east_m + width_m, north_m),
        (east_m + width_m, north_m + depth_m),
        (east_m, north_m + depth_m),
    ]


def mission_text(
    box: Points,
    fence: Points,
    holes: Collection[Points] = (),
    *,
    vehicles: int = 1,
    homes: Collection[tuple[float, float]] = (),
    capacity_wh: float = 25.0,
    altitude_m: float = 12.0,
    layer_m: float = 6.0,
    speed_m_s: float = 5.0,
    drift_m_s: float = 0.0,
    toward_deg: float = 0.0,
    frames: int = 5,
    positive: int = 3,
    strategy: str = "rdfs",
    interval_s: float = 0.25,
    margin_m: float = 2.0,
    wind_m_s: float = 0.0,
    mounting: str = "fixed",
    rate_m_s: float | None = None,
    regions: Collection[Points] = (),
) -> str:
    """Return the TOML of a mission from ground metres along the grid around the start.

    `regions` are those of the simulated ground; no key may be added to its `[sim]` above them.
    `rate_m_s` is that of climbs and descents, if the mission states one.
    """
    grid = Grid.at(START, CELL_M)
    sections = []
    for i in range(vehicles):
        sections.append("[[vehicles]]")
        if homes:
            place = grid.position(GridPoint(*list(homes)[i]))
            sections.append(f"home = [{place.lat_deg:.9f}, {place.lon_deg:.9f}]")
    rings = "".join(f"[[sim.roi]]\npolygon = {ring(grid, region)}\n" for region in regions)
    rates = "" if rate_m_s is None else f"\nclimb_m_s = {rate_m_s}\ndescent_m_s = {rate_m_s}"
    return f"""
        strategy = "{strategy}"
        [start]
        position = [{START.lat_deg}, {START.lon_deg}]
        [search]
        box = {ring(grid, box)}
        [fence]
        polygon = {ring(grid, fence)}
        holes = [{", ".join(ring(grid, hole) for hole in holes)}]
        margin_m = {margin_m}
        [grid]
        cell_m = {CELL_M}
        [flight]
        altitude_m = {altitude_m}
        speed_m_s = {speed_m_s}{rates}
        [camera]
        mounting = "{mounting}"
        interval_s = {interval_s}
        [votes]
        frames = {frames}
        positive = {positive}
        [battery]
        capacity_wh = {capacity_wh}
        [wind]
        speed_m_s = {wind_m_s}
        [drift]
        speed_m_s = {drift_m_s}
        toward_deg = {toward_deg}
        [team]
        layer_m = {layer_m}
        {chr(10).join(sections)}
{rings}"""


def with_small_pictures(text: str) -> str:
    """Return the TOML of a mission with pictures of 240 x 180 px, which are quick to simulate."""
    small = "[camera]\nwidth_px = 240\nheight_px = 180\npixels_per_cell = 20"
    return text.replace("[camera]", small)


def mission(box: Points, fence: Points, holes: Collection[Points] = (), **how: Any) -> Mission:
    return parse_mission(mission_text(box, fence, holes, **how), "test")


def random_scenario(seed: int, *, drift: bool = False, strategy: str | None = None) -> Scenario:
    """Return a mission by seed: 1 to 4 vehicles, a ROI of 4 to 24 cells that starts in the box.

    The hole lies anywhere beyond the row of homes, so it may cut the box or the ROI.
    """
    rng = np.random.default_rng([seed, int(drift)])
    vehicles = int(rng.integers(1, 5))
    west_m, south_m = float(rng.uniform(-30, 10)), float(rng.uniform(14, 30))
    width_m, depth_m = float(rng.uniform(16, 45)), float(rng.uniform(12, 35))
    room_m = 200.0 if drift else 40.0
    fence = [
        (-room_m, -room_m + float(rng.uniform(0, 20))),
        (60 + room_m - 30, -room_m),
        (60 + room_m - 30 + float(rng.uniform(-8, 8)), 60 + room_m - 20),
        (float(rng.uniform(-10, 30)), 75 + room_m - 20),
        (-room_m, 50 + room_m - 20),
    ]
    hole = square(
        west_m + float(rng.uniform(-10, width_m)),
        south_m + float(rng.uniform(-4, depth_m)),
        float(rng.uniform(5, 14)),
        float(rng.uniform(5, 14)),
    )
    hole_too = not drift and bool(rng.random() < 0.6)
    speed_m_s = float(rng.choice([1.5, 5.0]))
    # the charge for the farthest place, and between a little and twice as much in addition
    away_m = math.hypot(max(abs(west_m), abs(west_m + width_m)) + 20, south_m + depth_m) + 25
    sortie_s = 2.4 * away_m / speed_m_s + 30 + 3 * (12 + 6 * vehicles)
    capacity_wh = sortie_s * 300 / 3600 * 1.15 / 0.85 * float(rng.uniform(1.0, 1.3))
    drift_m_s = float(rng.uniform(0.05, 0.2)) if drift else 0.0
    toward_deg = float(rng.uniform(0, 360))
    paper = str(rng.choice(["rdfs", "rdfs-paper"]))
    interval_s = float(rng.choice([0.25, 1.0]))
    made = mission(
        square(west_m, south_m, width_m, depth_m),
        fence,
        [hole] if hole_too else [],
        vehicles=vehicles,
        capacity_wh=capacity_wh,
        speed_m_s=speed_m_s,
        drift_m_s=drift_m_s,
        toward_deg=toward_deg,
        strategy=strategy or paper,
        mounting="fixed" if strategy is None else "gimbal",
        interval_s=interval_s,
    )
    seat = Cell(
        round((west_m + float(rng.uniform(0.2, 0.8)) * width_m) / CELL_M),
        round((south_m + float(rng.uniform(0.2, 0.8)) * depth_m) / CELL_M),
    )
    grown = eden(int(rng.integers(4, 50)), rng)
    roi = frozenset(Cell(seat.east + e, seat.north + n) for e, n in grown)
    return Scenario(made, roi)


def at_heights(mission: Mission, heights_m: Sequence[float]) -> Mission:
    """Return the mission with homes at these heights above the start, in their order."""
    vehicles = [
        vehicle.model_copy(update={"home_height_m": height_m})
        for vehicle, height_m in zip(mission.vehicles, heights_m, strict=True)
    ]
    return mission.model_copy(update={"vehicles": tuple(vehicles)})


def first_patch(text: str) -> str:
    """Return a shipped mission that ends with the first patch, at the height of the map.

    `runway` and `burn` were such missions until decision 38, and so are figures of that time.
    """
    keys = 'find|altitude_m = "auto"  |climb_m_s|descent_m_s'
    head, search, rest = text.partition("[search]\n")
    return head + search + re.sub(rf"(?m)^(?:{keys}).*\n(?: +#.*\n)*", "", rest)


def with_receivers(mission: Mission, height_sigma_m: float) -> Mission:
    """Return the mission with receivers whose heights have this standard deviation."""
    quirks = mission.sim.quirks.model_copy(update={"height_sigma_m": height_sigma_m})
    return mission.model_copy(update={"sim": mission.sim.model_copy(update={"quirks": quirks})})


def scattered(scenario: Scenario, seed: int, *, high: bool = False) -> Scenario:
    """Return the mission by `swath` with `search.find = "all"`, and one to three patches more.

    `high`: searched from layers of its own, up to 10 m above the highest of the map.
    """
    made, rng = scenario.mission, np.random.default_rng([seed, 11])
    found = made.search.model_copy(update={"find": "all"})
    if high:
        lowest_m = made.altitude_m(len(made.vehicles)) + float(rng.uniform(0.0, 10.0))
        found = found.model_copy(update={"altitude_m": lowest_m})
    mission = made.model_copy(update={"strategy": "swath", "search": found})
    box, roi = setting_of(mission).box_cells, set(scenario.roi)
    for _ in range(int(rng.integers(1, 4))):
        seat = box[int(rng.integers(len(box)))]
        grown = eden(int(rng.integers(1, 9)), rng)
        roi |= {Cell(seat.east + e, seat.north + n) for e, n in grown}
    return Scenario(mission, frozenset(roi))


def unkind_scenario(seed: int, strategy: str | None = None) -> Scenario:
    """Return a small mission for a world with faults: a ROI of 4 to 20 cells, seldom none.

    It has one to three vehicles, a hole that may lie beside the homes, and a given wind. Its
    batteries last for one sortie or for half of one. Missions that cannot be flown are drawn
    again. With a `strategy` only the strategy differs.
    """
    rng = np.random.default_rng([seed, 7])
    while True:
        try:
            return _unkind(rng, strategy)
        except MissionFileError:
            continue


def _unkind(rng: np.random.Generator, strategy: str | None) -> Scenario:
    vehicles = int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
    west_m, south_m = float(rng.uniform(-14, 4)), float(rng.uniform(10, 22))
    width_m, depth_m = float(rng.uniform(12, 26)), float(rng.uniform(10, 18))
    fence = [
        (-32.0, float(rng.uniform(-24, -6))),
        (48.0, float(rng.uniform(-24, -6))),
        (float(rng.uniform(40, 56)), 52.0),
        (float(rng.uniform(-10, 30)), float(rng.uniform(52, 66))),
        (-32.0, 50.0),
    ]
    place = rng.random()
    holes: list[Points] = []
    if place < 0.2:  # beside the homes
        holes = [square(float(rng.uniform(-12, -9)), float(rng.uniform(-6, 0)), 6.0, 6.0)]
    elif place < 0.5:
        holes = [square(float(rng.uniform(-16, 16)), float(rng.uniform(6, 40)), 6.0, 8.0)]
    wind_m_s = float(rng.choice([0.0, 2.0, 5.0]))
    speed_m_s = float(rng.choice([2.5, 5.0]))
    away_m = math.hypot(max(abs(west_m), abs(west_m + width_m)) + 12, south_m + depth_m) + 15
    sortie_s = 2.4 * away_m / speed_m_s + 40 + 3 * (12 + 6 * vehicles)
    capacity_wh = sortie_s * 300 / 3600 * 1.15 / 0.85 * float(rng.uniform(1.05, 2.0))
    drifts = rng.random() < 0.15
    layer_m, drawn = float(rng.choice([4.5, 6.0])), str(rng.choice(UNKIND_STRATEGIES))
    made = mission(
        square(west_m, south_m, width_m, depth_m),
        fence,
        holes,
        vehicles=vehicles,
        capacity_wh=capacity_wh,
        speed_m_s=speed_m_s,
        altitude_m=14.0,
        mounting="gimbal",
        layer_m=layer_m,
        strategy=strategy or drawn,
        wind_m_s=wind_m_s,
        drift_m_s=float(rng.uniform(0.05, 0.2)) if drifts else 0.0,
        toward_deg=float(rng.uniform(0, 360)),
    )
    if rng.random() < 0.1:
        return Scenario(made, frozenset())
    seat = Cell(
        round((west_m + float(rng.uniform(0.2, 0.8)) * width_m) / CELL_M),
        round((south_m + float(rng.uniform(0.2, 0.8)) * depth_m) / CELL_M),
    )
    grown = eden(int(rng.integers(4, 21)), rng)
    return Scenario(made, frozenset(Cell(seat.east + e, seat.north + n) for e, n in grown))


def reachable(setting: Setting, roi: Collection[Cell], root: Cell) -> tuple[set[Cell], set[Cell]]:
    """Return the ROI cells that are observed, and those that must be in the map, without drift.

    A cell is observed if cells whose centres the fence allows connect it with the root. The map
    holds these and their neighbours in the ROI.
    """
    looked: set[Cell] = set()
    todo = [root]
    while todo:
        cell = todo.pop()
        if cell in looked or cell not in roi:
            continue
        if not setting.fence.allows(setting.grid.centre_of(cell)):
            continue
        looked.add(cell)
        todo.extend(cell.neighbours())
    return looked, looked | {n for c in looked for n in c.neighbours() if n in roi}


def joined(state: State, events: Iterable[Event]) -> State:
    """Return the state of a member after its journal, with the map of its facts in any order."""
    facts = facts_of(state.setting)
    for event in events:
        facts.add(event)
    return with_map(state, facts)
