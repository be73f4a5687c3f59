"""The heights of the ground from the autopilot before a flight, if the mission file requires it.

The answer becomes the lattice of the mission, as that of a GeoTIFF does.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from missions.units import LatLon
from uavmap.aircraft.cameras.spec import parse_camera
from uavmap.base.clock import Clock, ScaledClock, VirtualClock, run
from uavmap.journal.flight_plan import PYMAVLINK, FlightPlan
from uavmap.load.dem import MAX_STEP_M, FenceLattice, with_lattice
from uavmap.mavlink.autopilots import PX4
from uavmap.mavlink.identity import wait_for_autopilot
from uavmap.mavlink.session import Message, Session
from uavmap.runner.preflight.examination import open_answering_links

MIN_STEP_M: Final = 10.0
"""Minimum distance of two requested places, m: databases of autopilots have 30 to 100 m."""
MAX_PLACES: Final = 1500


def with_ground(plan: FlightPlan) -> FlightPlan:
    """Return the plan with the ground from its first vehicle's autopilot, if it requires that.

    Raises `LinkError` if the autopilot does not answer or has no ground there, `MissionFileError`
    if that ground cannot be flown over.
    """
    mission = plan.mission
    if mission.terrain is None or mission.terrain.source is None:
        return plan
    table: dict[str, Any] = {}

    async def survey() -> None:
        async with asyncio.TaskGroup() as tasks:
            if plan.simulated:
                table.update(await _simulated(plan, mission, tasks))
            else:
                table.update(await _connected(plan, mission))

    clock: Clock = VirtualClock(None) if plan.simulated else ScaledClock(plan.speedup or 1.0)
    run(survey(), clock)
    surveyed = replace(plan, mission=with_lattice(mission, table))
    surveyed.check_mission()
    return surveyed


async def _simulated(
    plan: FlightPlan, mission: Mission, tasks: asyncio.TaskGroup
) -> dict[str, Any]:
    from uavmap.runner.simulation import Simulation  # noqa: PLC0415 - real aircraft need no simulator

    simulation = Simulation(setting_of(mission), plan.seed)
    session = simulation.open_session(0, lambda frame: None)
    world = tasks.create_task(simulation.run())
    table = await _lattice(session, simulation.names()[0], mission)
    world.cancel()
    return table


async def _connected(plan: FlightPlan, mission: Mission) -> dict[str, Any]:
    options = replace(plan, urls=plan.urls[:1], driver=PYMAVLINK, forward=())
    async with open_answering_links(options, [parse_camera("mavlink")], mission.camera) as (link,):
        return await _lattice(link.session, link.name, mission)


async def _lattice(session: Session, name: str, mission: Mission) -> dict[str, Any]:
    await wait_for_autopilot(session, name)
    lattice = FenceLattice.around(mission, MIN_STEP_M, MAX_PLACES / 1.2)
    if lattice.step_m > MAX_STEP_M:
        raise LinkError(
            f"{name}: the places of a fence so large that an autopilot can be asked for lie "
            f"{lattice.step_m:.0f} m apart, more than {MAX_STEP_M:g}; draw it smaller, or give "
            'terrain.dem = "FILE.tif" instead'
        )
    shape = lattice.rows, lattice.columns
    places = [lattice.at(row, column) for row, column in np.ndindex(shape)]
    *heights, start_m = await _heights(session, name, [*places, mission.home])
    return lattice.table(np.array(heights).reshape(shape) - start_m)


_LOG: Final = logging.getLogger("uavmap.runner.preflight")
AT_ONCE: Final = 8
"""Number of places that are requested at a time: a slow radio holds no more."""
WAIT_S: Final = 1.0
"""Time until places without an answer are requested again, s."""
MAX_ANSWER_WAIT_S: Final = 30.0
"""Maximum time without a new answer, s: an autopilot reads its card or asks a ground station."""
_INSTEAD: Final = 'give terrain.dem = "FILE.tif" instead'

Place = tuple[int, int]
"""Latitude and longitude, in units of 1e-7 degrees, as on the wire."""


async def _heights(session: Session, name: str, places: Sequence[LatLon]) -> list[float]:
    """Return the heights above the sea at places, m. Raises `LinkError` if there are none."""
    if session.view.kind is PX4:
        raise LinkError(f"{name}: a PX4 does not report its terrain; {_INSTEAD}")
    known: dict[Place, float] = {}
    pending: int | None = None

    def take(message: Message) -> None:
        nonlocal pending
        pending = message.pending
        if message.spacing > 0:
            known[message.lat, message.lon] = float(np.float32(message.terrain_height))

    session.listen(take, "TERRAIN_REPORT")
    wanted = [(round(p.lat_deg * 1e7), round(p.lon_deg * 1e7)) for p in places]
    _LOG.info(f"{name}: asks the autopilot for the ground at {len(wanted)} places")
    loop = asyncio.get_running_loop()
    came_s = loop.time()
    while missing := [place for place in wanted if place not in known]:
        before, asked = len(known), missing[:AT_ONCE]
        for lat_e7, lon_e7 in asked:
            session.send(mav.MAVLink_terrain_check_message(lat_e7, lon_e7))
        await session.until(lambda a=asked: set(a) <= known.keys(), WAIT_S)  # type: ignore[misc]
        if len(known) > before:
            came_s = loop.time()
        elif loop.time() - came_s > MAX_ANSWER_WAIT_S and pending is None:
            raise LinkError(
                f"{name}: the autopilot does not answer TERRAIN_CHECK (is TERRAIN_ENABLE 1?); "
                f"{_INSTEAD}"
            )
        elif loop.time() - came_s > MAX_ANSWER_WAIT_S:
            raise LinkError(
                f"{name}: the autopilot knows no ground at {len(missing)} of {len(wanted)} places, "
                f"and waits for {pending} blocks of it; put terrain data on its card, connect a "
                f"ground station that sends them, or {_INSTEAD}"
            )
    return [known[place] for place in wanted]
