"""Put back what a flight left set on its autopilots, and nothing else.

A dry run, a refusal or a completed flight may end with a vehicle that is silent; its settings wait
in the folder for `uavmap resume`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from pathlib import Path
from typing import Final

from missions.errors import LinkError
from missions.flight.setting import Setting
from uavmap.aircraft.cameras.spec import parse_camera
from uavmap.base.clock import ScaledClock, run
from uavmap.journal.flight_plan import FlightPlan
from uavmap.runner.flight_links import Link, LinkOptions, opened_links
from uavmap.runner.preflight.autopilot_setup import HEARD_S, AutopilotSetup
from uavmap.runner.preflight.examination import connect, heartbeats
from uavmap.runner.preflight.saved_settings import Kept

_LOG: Final = logging.getLogger("uavmap.flight")


def is_left_set(folder: Path) -> bool:
    """Whether a flight of this folder has left something set on an autopilot."""
    return not Kept(folder).empty


def put_back(plan: FlightPlan, setting: Setting, folder: Path) -> bool:
    """Connect to the vehicles and set back what they had; whether nothing is left to be done."""
    run(_put_back(plan, setting, folder), ScaledClock(plan.speedup or 1.0))
    return not is_left_set(folder)


async def _put_back(plan: FlightPlan, setting: Setting, folder: Path) -> None:
    cameras = [parse_camera("mavlink")] * len(plan.urls)
    section = setting.mission.camera
    async with contextlib.AsyncExitStack() as stack:
        links = await stack.enter_async_context(
            opened_links(plan.urls, LinkOptions.of(plan), cameras, section, lambda frame: None)
        )
        beating = asyncio.create_task(heartbeats([link.session for link in links]))
        stack.callback(beating.cancel)
        numbered = enumerate(links, start=setting.member or 1)
        await asyncio.gather(*(_one(n, link, setting, folder) for n, link in numbered))


async def _one(number: int, link: Link, setting: Setting, folder: Path) -> None:
    setup = AutopilotSetup(number, link.session, setting, folder)
    try:
        await connect(link.session, link.name)
    except LinkError as error:
        _log_of(number, str(error))
        return
    view = link.session.view
    await link.session.until(lambda: view.on_ground, max(HEARD_S, 2.0 * link.session.ack_wait_s))
    if await setup.restore():
        _log_of(number, "has its own settings")


def _log_of(number: int, text: str) -> None:
    _LOG.info(f"vehicle {number}: {text}")
