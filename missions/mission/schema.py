"""The mission file: TOML in, a `Mission` out. docs/reference/missions.md describes each key.

Unknown keys are errors. Every message names the file, the key, the value and the expected value.
Checks that need geometry are in `missions.mission.checks`; `parse_mission` runs both. Defaults are
the field values of Sung and Tokekar, section 7: 4 m cells, 12 m altitude, intensity 150, 7
dilations, 5 frames, 3 votes. Positions are `[latitude, longitude]` in degrees.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from missions.errors import MissionFileError
from missions.geo.footprint import Optics
from missions.geo.terrain import Relief, Terrain
from missions.mission.messages import explain
from missions.mission.sections import (
    AUTO,
    Altitude,
    Count,
    DetectorSection,
    Drift,
    FileName,
    Guardian,
    HostName,
    Lattice,
    NotNegative,
    Number,
    Positive,
    Ring,
    Search,
    Section,
    TagDictionary,
    Team,
    TerrainSection,
    Traffic,
    Vertex,
    Votes,
    Wind,
    relief_in,
    terrain_in,
)
from missions.mission.sim_section import Sim
from missions.units import LatLon

MAX_VEHICLES = 50
MAX_OVERSHOOT_M = 1.5
"""Maximum height of a vehicle above its layer, m."""


def positions(ring: tuple[Vertex, ...]) -> tuple[LatLon, ...]:
    """Return the vertices of a ring as positions."""
    return tuple(LatLon(lat, lon) for lat, lon in ring)


class Start(Section):
    """The start: home of the first vehicle, and centre of cell (0, 0)."""

    position: Vertex
    amsl_m: Annotated[Number, Field(ge=-500, le=9000)] = 0.0


class Zone(Section):
    """A zone of an authority that meets the fence, as kept of a file."""

    name: str
    why: str
    """Its restriction, heights, times and file, in words."""
    effect: Literal["hole", "above", "allowed"]
    holes: tuple[Count, ...] = ()
    """Numbers of the holes of the fence that it is a part of, from 0."""


def _kept_zones(value: object) -> object:
    paths = value if isinstance(value, list | tuple) else [value]
    if any(isinstance(path, str) for path in paths):
        raise PydanticCustomError(
            "zone_paths", "files of zones are read only beside the mission file that names them"
        )
    return value


class Fence(Section):
    """The geofence: stay inside `polygon`, outside of every hole."""

    polygon: Ring
    holes: tuple[Ring, ...] = ()
    zones: Annotated[tuple[Zone, ...], BeforeValidator(_kept_zones)] = ()
    """Their holes are among `holes`."""
    allowed_zones: tuple[str, ...] = ()
    margin_m: NotNegative = 2.0
    ceiling_m: Annotated[Number, Field(gt=0, le=1000)] = 120.0
    """Maximum height, m; the default is the limit of most countries."""


class GridSection(Section):
    """The grid."""

    cell_m: Positive = 4.0


class Flight(Section):
    """The flight of the vehicles. `speed_m_s` is over ground."""

    altitude_m: Altitude = 12.0
    height_above: Literal["home", "ground"] = "home"
    speed_m_s: Annotated[Number, Field(gt=0, le=30)] = 1.0
    settle_m_s: Positive = 0.5
    max_airspeed_m_s: Annotated[Number, Field(gt=0, le=60)] = 12.0
    accel_m_s2: Annotated[Number, Field(ge=0.5, le=5)] = 2.0
    climb_m_s: Annotated[Number, Field(ge=0.5, le=10)] | None = None
    """Climb rate, m/s: WPNAV_SPEED_UP, MPC_Z_V_AUTO_UP; without it 1.5, less than both defaults."""
    descent_m_s: Annotated[Number, Field(ge=0.5, le=5)] | None = None
    """Descent rate, m/s: WPNAV_SPEED_DN, MPC_Z_V_AUTO_DN; without it a landing takes 0.5
    throughout."""


class CameraSection(Section):
    """The camera. `fixed` tilts with the airframe, `gimbal` holds it straight down."""

    hfov_deg: Annotated[Number, Field(gt=1, lt=170)] = 80.0
    width_px: Annotated[Count, Field(ge=16, le=20000)] = 640
    height_px: Annotated[Count, Field(ge=16, le=20000)] = 480
    mounting: Literal["fixed", "gimbal"] = "fixed"
    yaw_deg: Annotated[Number, Field(ge=-360, le=360)] = 0.0
    pitch_deg: Annotated[Number, Field(ge=-45, le=45)] = 0.0
    roll_deg: Annotated[Number, Field(ge=-45, le=45)] = 0.0
    """Mounting angle of a camera that does not report its attitude, degrees."""
    latency_s: Annotated[Number, Field(ge=-1, le=10)] = 0.0
    interval_s: Annotated[Number, Field(gt=0, le=60)] = 1.0
    """Time between two frames of a cell, s."""
    pixels_per_cell: Positive = 80.0
    """Pixels of a cell's edge from the highest layer."""
    pose_error_m: NotNegative = 0.5
    """Error of the pose, m: frames that judge all they show leave out cells this near to the
    edge."""
    exposure_s: Annotated[Number, Field(gt=0, le=1)] = 0.002
    """Exposure time, s; the default is 1/500 s, for daylight."""
    max_blur_px: Positive = 1.5
    """Maximum motion blur, px; the detector's dilations, the width of the ROI's border, must be
    larger."""
    hosts: tuple[HostName, ...] = ()
    calibration: Annotated[str, Field(strict=True, min_length=1, max_length=4096)] | None = None
    """Calibration for recorded pictures (`uavmap replay`, `uavmap look`); a flight uses
    `hfov_deg`."""
    noiseless: bool = False
    """Accept pictures that are uniform or repeat."""

    @property
    def optics(self) -> Optics:
        """Pinhole camera of the mission."""
        return Optics(math.radians(self.hfov_deg), self.width_px, self.height_px)


class Battery(Section):
    """The battery: its capacity, and the reserve at touch-down."""

    capacity_wh: Positive = 60.0
    hover_power_w: Positive = 300.0
    reserve: Annotated[Number, Field(ge=0, lt=1)] = 0.15

    @property
    def endurance_s(self) -> float:
        """Hovering time from full to empty in still air."""
        return self.capacity_wh * 3600.0 / self.hover_power_w


class NavigationSection(Section):
    """Behaviour when satellites give no position, or a false one."""

    gnss_loss: Literal["map", "leapfrog", "rtl", "land"] = "rtl"
    """Behaviour on loss in flight, by map, by leapfrog, or by the autopilot.

    "map" continues by the vehicle's own map, "leapfrog" by the two vehicles' views of each other
    (strategy "leapfrog"). Others return or land by the autopilot, whose failsafe has priority.
    """
    watch: Annotated[bool, Field(strict=True)] | None = None
    """True to detect a false position by pictures; by default with `gnss_loss = "map"`."""
    tolerated_m: Positive = 0.6
    """Tolerated error beyond chance, m."""
    tag_m: Annotated[Number, Field(gt=0, le=5)] = 0.4
    """Edge of the black square on the mapper's top (strategy "leapfrog"), m."""
    tag_dictionary: TagDictionary = "DICT_4X4_50"

    @property
    def watches(self) -> bool:
        """True if positions are compared with pictures."""
        return self.gnss_loss == "map" if self.watch is None else self.watch


class VehicleSection(Section):
    """One vehicle: its link, its camera, and its home if that is not the start."""

    url: str | None = None
    camera: str | None = None
    """Camera; not for a simulated flight, whose cameras are simulated as well."""
    home: Vertex | None = None
    home_height_m: Annotated[Number, Field(ge=-1000, le=1000)] | None = None
    layer: Annotated[Count, Field(ge=0)] | None = None
    """Number of its layer; by default each has its own. Vehicles in one layer wait for each
    other."""


class Mission(Section):
    """A whole mission file. The shipped missions (`missions/shipped`) are examples."""

    name: FileName = "mission"
    strategy: str = "rdfs"
    start: Start
    search: Search
    fence: Fence
    grid: GridSection = GridSection()
    flight: Flight = Flight()
    camera: CameraSection = CameraSection()
    detector: DetectorSection = DetectorSection()
    votes: Votes = Votes()
    battery: Battery = Battery()
    wind: Wind = Wind()
    drift: Drift = Drift()
    team: Team = Team()
    traffic: Traffic = Traffic()
    guardian: Guardian = Guardian()
    navigation: NavigationSection = NavigationSection()
    vehicles: Annotated[
        tuple[VehicleSection, ...], Field(min_length=1, max_length=MAX_VEHICLES)
    ] = (VehicleSection(),)
    terrain: TerrainSection | None = None
    sim: Sim = Sim()

    @property
    def by_evidence(self) -> bool:
        """True if evidence decides cells of recorded pictures; flights count votes."""
        if self.votes.recorded is None:
            return self.detector.view == "all"
        return self.votes.recorded == "evidence"

    @property
    def surveyed(self) -> Terrain | None:
        """Known ground, whether it is followed or not."""
        return None if self._lattice is None else terrain_in(self._lattice)

    @property
    def _lattice(self) -> Lattice | None:
        return None if self.terrain is None else self.terrain.dem

    @property
    def ground(self) -> Terrain | None:
        """Ground below the layers; None means that they are above the start, and the ground is
        flat."""
        return self.surveyed if self.flight.height_above == "ground" else None

    @property
    def relief(self) -> Relief | None:
        """Relief of the known ground inside the fence."""
        if self._lattice is None:
            return None
        return relief_in(self._lattice, self.start.position, self.fence.polygon)

    @property
    def highest_ground_m(self) -> float:
        """Highest ground in the fence above the start, at least 0; 0 if it is not followed, m.

        Ceilings and return heights, which are above home, are higher by it. An autopilot returns
        straight, also over the ground between two arms of the fence.
        """
        crossed = self._crossed
        return 0.0 if crossed is None else max(crossed.highest_m, 0.0)

    @property
    def ground_span_m(self) -> float:
        """Height from the lowest ground to the highest, m; 0 if it is not followed."""
        crossed = self._crossed
        return 0.0 if crossed is None else self.highest_ground_m - min(crossed.lowest_m, 0.0)

    @property
    def _crossed(self) -> Relief | None:
        """Relief below straight ways in the fence, if ground is followed."""
        if self.ground is None or self._lattice is None:
            return None
        return relief_in(self._lattice, self.start.position, self.fence.polygon, hull=True)

    @property
    def home(self) -> LatLon:
        """The start."""
        return LatLon(*self.start.position)

    def search_altitude_m(self, vehicle: int) -> float | None:
        """Return the search layer of a vehicle (from 0, the lowest); None: it searches in its map
        layer.

        "auto" as in `altitude_m`, with the pixels of a suspicion.
        """
        if self.search.altitude_m is None:
            return None
        apart_m = self.team.layer_m if self.search.layer_m is None else self.search.layer_m
        return self._layer_m(self.search.altitude_m, self.search.pixels_per_cell, vehicle, apart_m)

    def top_altitude_m(self, vehicle: int) -> float:
        """Return the highest layer of a vehicle (from 0), m."""
        return max(self.altitude_m(vehicle), self.search_altitude_m(vehicle) or 0.0)

    @property
    def overview_above_m(self) -> float | None:
        """Height above which a frame is one of the search alone, m; None without search height.

        From there a cell has less than `camera.pixels_per_cell`.
        """
        low_m, top_m = self.search_altitude_m(0), self.altitude_m(len(self.vehicles) - 1)
        if low_m is None:
            return None
        fine_m = self.camera.optics.height_m(self.grid.cell_m, self.camera.pixels_per_cell)
        return min(max(fine_m, top_m + MAX_OVERSHOOT_M), (top_m + low_m) / 2.0)

    def altitude_m(self, vehicle: int) -> float:
        """Return the layer of a vehicle (from 0) above home, or above the ground.

        With `flight.altitude_m = "auto"` the highest layer is as high as a cell still has its
        pixels, in tenths of a metre. It is at the ceiling if that is lower. The others lie below
        it.
        """
        apart_m = self.team.layer_m
        return self._layer_m(self.flight.altitude_m, self.camera.pixels_per_cell, vehicle, apart_m)

    def _layer_m(
        self,
        lowest_m: float | Literal["auto"],
        pixels_per_cell: float,
        vehicle: int,
        layer_m: float,
    ) -> float:
        if lowest_m == AUTO:
            fine_m = self.camera.optics.height_m(self.grid.cell_m, pixels_per_cell)
            room_m = self.fence.ceiling_m - self.highest_ground_m
            top_m = math.floor(min(fine_m, room_m) * 10.0 + 1e-9) / 10.0
            above = self.layer_number(len(self.vehicles) - 1) - self.layer_number(vehicle)
            return round(top_m - above * layer_m, 6)
        return lowest_m + self.layer_number(vehicle) * layer_m

    def layer_number(self, vehicle: int) -> int:
        """Return the number of a vehicle's layer (both from 0), 0 being the lowest."""
        if vehicle >= len(self.vehicles):
            return vehicle
        layer = self.vehicles[vehicle].layer
        return vehicle if layer is None else layer

    @model_validator(mode="after")
    def _layers_in_order(self) -> Mission:
        numbers = [vehicle.layer for vehicle in self.vehicles]
        if set(numbers) == {None}:
            return self
        steps = list(zip([0, *numbers], numbers, strict=False))
        if any(b is None or a is None or b - a not in (0, 1) for a, b in steps) or numbers[0] != 0:
            raise ValueError(
                "vehicles.layer: give all vehicles one or none; the first has 0, each other one "
                "that of the vehicle before it, or the next"
            )
        return self


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Return the tables of a mission file. Raises `MissionFileError` if it is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MissionFileError(f"{source}: not a TOML file: {error}") from None
    except RecursionError:
        raise MissionFileError(f"{source}: not a TOML file: nested too deeply") from None


def parse_fields(text: str, source: str) -> Mission:
    """Return a mission whose single values are valid; `missions.mission.checks` checks the whole.

    Raises `MissionFileError` with a line for each fault: file, key, value and expectation.

    >>> parse_fields("grid.cell_m = 0", "x.toml")
    Traceback (most recent call last):
    missions.errors.MissionFileError: x.toml: start: missing; add it...
    """
    return mission_of_tables(parse_toml(text, source), source)


def mission_of_tables(tables: Mapping[str, Any], source: str) -> Mission:
    """Make a mission of the tables of its file. Raises `MissionFileError` as `parse_fields`."""
    try:
        return Mission.model_validate(tables)
    except ValidationError as error:
        lines = [f"{source}: {fault}" for fault in explain(error, Mission)]
        raise MissionFileError("\n".join(lines)) from None
