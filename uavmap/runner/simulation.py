"""The only door to `sitl`: a mission's world and aircraft, in this process or on sockets.

In this process a vehicle and the service exchange the same MAVLink bytes as over a socket.
"""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from missions.errors import LinkError
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission.places import home_heights_m, homes
from missions.mission.schema import Mission, positions
from missions.mission.sim_section import SimFault
from missions.planning.sweep.strategies import LEAPFROG
from missions.units import GridPoint, LatLon
from sitl.camera.pinhole import CameraSpec
from sitl.faults.faults import Faults
from sitl.quirks import Quirks
from sitl.scenario import Home, Setup
from sitl.sockets.server import serve
from sitl.vehicle import SimVehicle
from sitl.world.files import load_ground
from sitl.world.ground import HeightField, Relief
from sitl.world.traffic import Intruder
from sitl.world.world import Patch
from uavmap.mavlink.session import Session

STEP_S = 0.05
serve_vehicles: Final = serve
setup_without_mission: Final = Setup
"""Setup for `uavmap sitl`, through this door."""
_LOOK_EVERY_STEPS = 2
_SAME: Final = {
    *("roi_intensity", "ground_intensity", "texture", "sensor_noise", "illumination", "gust_m_s"),
    *("world", "gps_sigma_m", "gps_tau_s", "optical_flow", "odometry_drift"),
}
"""Keys of a mission's [sim] with the same names in the simulator."""


def setup_of(
    mission: Mission, seed: int, *, autopilot: str | None = None, start_s: float = 0.0
) -> Setup:
    """Return the simulation of a mission at time `start_s`, with another `autopilot` if given."""
    sim, grid = mission.sim, setting_of(mission).grid
    places, relief = homes(mission), relief_of(mission, grid)
    raised = relief is None and any(vehicle.home_height_m for vehicle in mission.vehicles)
    pad_heights_m = home_heights_m(mission) if raised else ()

    def drifted(ring: Sequence[LatLon]) -> tuple[LatLon, ...]:
        return tuple(grid.position(grid.to_fixed(grid.fixed(p), start_s)) for p in ring)

    return Setup(
        autopilot=autopilot or sim.autopilot,
        vehicles=len(places),
        home=Home(mission.home.lat_deg, mission.home.lon_deg, mission.start.amsl_m),
        places=places,
        pad_heights_m=pad_heights_m,
        seed=seed,
        wind_speed_m_s=mission.wind.speed_m_s,
        wind_from_deg=mission.wind.from_deg,
        patches=tuple(
            Patch(
                drifted(positions(region.polygon)),
                tuple(drifted(positions(hole)) for hole in region.holes),
                region.rgb,
            )
            for region in sim.roi
        ),
        drift_speed_m_s=mission.drift.speed_m_s,
        drift_toward_deg=mission.drift.toward_deg,
        camera=CameraSpec(
            hfov_deg=mission.camera.hfov_deg,
            width_px=mission.camera.width_px,
            height_px=mission.camera.height_px,
            fixed=mission.camera.mounting == "fixed",
            yaw_deg=mission.camera.yaw_deg,
            min_interval_s=min(mission.camera.interval_s, 0.2),
            exposure_s=mission.camera.exposure_s,
        ),
        battery_wh=mission.battery.capacity_wh,
        hover_power_w=mission.battery.hover_power_w,
        swap_after_s=sim.swap_s,
        quirks=Quirks(**sim.quirks.model_dump()),
        parameters={
            **_return_height(mission, autopilot or sim.autopilot),
            **_climbs(mission, autopilot or sim.autopilot),
            **sim.parameters,
        },
        relief=relief,
        tag_m=_tag_m(mission),
        tag_dictionary=sim.tag_dictionary or mission.navigation.tag_dictionary,
        traffic=tuple(
            Intruder(
                LatLon(*one.position),
                one.height_m,
                one.toward_deg,
                one.speed_m_s,
                one.at_s - start_s,
                math.inf if one.for_s is None else one.for_s,
                one.name,
                one.kind,
            )
            for one in sim.traffic
        ),
        **sim.model_dump(include=_SAME),
    )


def refuse_unreadable_world(mission: Mission) -> None:
    """Raise `WorldError` for a file of `sim.world` that cannot be shown."""
    load_ground(mission.sim.world, home=mission.home)


def _tag_m(mission: Mission) -> float:
    if mission.sim.tag_m is not None:
        return mission.sim.tag_m
    return mission.navigation.tag_m if mission.strategy == LEAPFROG.name else 0.0


def relief_of(mission: Mission, grid: Grid) -> Relief | None:
    """Return the ground of a mission's world above its start; None if it is level."""
    made, known = mission.sim.terrain, mission.surveyed
    if made is not None:
        return Relief(
            made.slope_percent / 100.0, made.rises_toward_deg, made.hills_m, made.hills_length_m,
            made.seed,
        )  # fmt: skip
    if known is None:
        return None
    # the lattice lies along the grid, the world along true north
    cos, sin = math.cos(grid.convergence_rad), math.sin(grid.convergence_rad)
    rows, columns = known.heights_m.shape
    west = np.array([known.west_m, known.west_m + known.step_m * (columns - 1)])
    south = np.array([known.south_m, known.south_m + known.step_m * (rows - 1)])
    east, north = (corner.ravel() for corner in np.meshgrid(west, south))
    true_east, true_north = east * cos + north * sin, north * cos - east * sin
    west_m, south_m = float(true_east.min()), float(true_north.min())
    across, along = np.meshgrid(
        np.arange(west_m, true_east.max() + known.step_m, known.step_m),
        np.arange(south_m, true_north.max() + known.step_m, known.step_m),
    )
    heights = known.at(across * cos - along * sin, across * sin + along * cos)
    heights -= known.height_m(GridPoint(0.0, 0.0))
    return Relief(field=HeightField(west_m, south_m, known.step_m, heights))


def _return_height(mission: Mission, autopilot: str) -> dict[str, float]:
    """Return the return height that preflight sets on real aircraft: above all hills."""
    if mission.ground is None:
        return {}
    height_m = mission.highest_ground_m + mission.top_altitude_m(len(mission.vehicles) - 1)
    if autopilot == "px4":
        return {"RTL_RETURN_ALT": height_m}
    return {"RTL_ALT": round(100.0 * height_m)}


def _climbs(mission: Mission, autopilot: str) -> dict[str, float]:
    up_m_s, down_m_s = mission.flight.climb_m_s, mission.flight.descent_m_s
    found: dict[str, float] = {}
    if up_m_s is not None:
        names = ("MPC_Z_V_AUTO_UP", "MPC_Z_VEL_MAX_UP", "MPC_TKO_SPEED")
        px4 = dict.fromkeys(names, up_m_s)
        found |= px4 if autopilot == "px4" else {"WPNAV_SPEED_UP": 100.0 * up_m_s}
    if down_m_s is not None:
        px4 = dict.fromkeys(("MPC_Z_V_AUTO_DN", "MPC_Z_VEL_MAX_DN"), down_m_s)
        found |= px4 if autopilot == "px4" else {"WPNAV_SPEED_DN": 100.0 * down_m_s}
    return found


def make_vehicles(
    mission: Mission,
    seed: int,
    *,
    autopilot: str | None = None,
    start_s: float = 0.0,
    image_url_prefix: str = "sim://",
) -> list[SimVehicle]:
    """Return the simulated aircraft of a mission, with its faults; see `setup_of`."""
    setup = setup_of(mission, seed, autopilot=autopilot, start_s=start_s)
    vehicles = setup.build(image_url_prefix)
    for fault in mission.sim.faults:
        if fault.vehicle <= len(vehicles):
            _schedule(vehicles[fault.vehicle - 1].fail, fault, start_s)
    return vehicles


def _schedule(faults: Faults, fault: SimFault, start_s: float) -> None:
    """Schedule the rest of a fault for vehicles whose time begins at mission time `start_s`."""
    begin_s = fault.at_s - start_s
    end_s = math.inf if fault.for_s is None else begin_s + fault.for_s
    if end_s <= 0.0 or (begin_s < 0.0 and fault.happens_once):
        return
    values: dict[str, Any] = {**fault.values, "after_s": max(0.0, begin_s)}
    if fault.for_s is not None:
        values["for_s"] = end_s - max(0.0, begin_s)
    elif fault.kind == "wind_gust":
        values["for_s"] = None
    getattr(faults, fault.kind)(**values)


@dataclass(slots=True)
class Truth:
    """The true course of a flight, observed from outside."""

    min_separation_m: float = math.inf
    fence_breaches: int = 0
    reserve_violations: int = 0
    crashes: int = 0
    _outside: set[int] = field(default_factory=set)
    _flying: set[int] = field(default_factory=set)
    _crashed: set[int] = field(default_factory=set)

    def figures(self) -> dict[str, float | int | None]:
        """Return its figures for the summary."""
        apart_m = self.min_separation_m
        return {
            "min_separation_m": round(apart_m, 2) if math.isfinite(apart_m) else None,
            "fence_breaches": self.fence_breaches,
            "reserve_violations": self.reserve_violations,
        }

    def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        """Observe all vehicles at one instant."""
        in_air: list[tuple[GridPoint, float]] = []
        for vehicle in vehicles:
            number, truth = vehicle.spec.system_id, vehicle.truth
            point = setting.grid.fixed(truth.position)
            if truth.crashed and number not in self._crashed:
                self._crashed.add(number)
                self.crashes += 1
            if truth.landed:
                if number in self._flying and truth.energy_wh < setting.energy.reserve_wh:
                    self.reserve_violations += 1
                self._flying.discard(number)
                continue
            self._flying.add(number)
            in_air.append((point, vehicle.up_m))
            if setting.fence.contains(point):
                self._outside.discard(number)
            elif number not in self._outside:
                self._outside.add(number)
                self.fence_breaches += 1
        for (a, a_m), (b, b_m) in itertools.combinations(in_air, 2):
            distance_m = math.hypot(a.distance_to(b), a_m - b_m)
            self.min_separation_m = min(self.min_separation_m, distance_m)


class Simulation:
    """Simulated aircraft in this process, each at the end of a session."""

    def __init__(self, setting: Setting, seed: int, *, start_s: float = 0.0) -> None:
        self._setting = setting
        self._vehicles = make_vehicles(setting.mission, seed, start_s=start_s)
        self._sessions: dict[int, Session] = {}
        self._turns: dict[int, int] = {}
        """Number of sessions with each that were opened or cut: only the last one is connected."""
        self.truth = Truth()

    @property
    def vehicles(self) -> Sequence[SimVehicle]:
        """The aircraft themselves, for an observer outside."""
        return self._vehicles

    def names(self) -> list[str]:
        """Return the vehicles by name, in order."""
        return [f"sim://{vehicle.spec.system_id}" for vehicle in self._vehicles]

    def open_session(self, index: int, record: Callable[[bytes], None]) -> Session:
        """Open a session with a vehicle (from 0) in the place of the one before."""
        vehicle = self._vehicles[index]
        loop = asyncio.get_running_loop()
        turn = self._turns[index] = self._turns.get(index, 0) + 1

        def send(frame: bytes) -> None:
            if self._turns[index] != turn:
                return
            if answer := vehicle.receive(frame):
                loop.call_soon(session.feed, answer)

        session = Session(send, record)
        self._sessions[index] = session
        return session

    async def fetch(self, url: str) -> bytes:
        """Return a picture by its URL."""
        for vehicle in self._vehicles:
            if (data := vehicle.image(url)) is not None:
                return data
        raise LinkError(f"{url}: there is no such picture")

    async def run(self) -> None:
        """Let the world's time pass with the loop's, until cancelled."""
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        for steps in itertools.count():
            for index, vehicle in enumerate(self._vehicles):
                frames = vehicle.step(STEP_S)
                if frames and index in self._sessions:
                    self._sessions[index].feed(frames)
            if steps % _LOOK_EVERY_STEPS == 0:
                self.truth.watch(self._vehicles, self._setting)
            await asyncio.sleep(start_s + (steps + 1) * STEP_S - loop.time())


def pictures_at(http_port: int) -> str:
    """Return the beginning of the URLs of pictures."""
    return f"http://127.0.0.1:{http_port}/"
