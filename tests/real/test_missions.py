"""Whole missions, with each driver, some strategies, and on a busy computer."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import sys
from collections.abc import AsyncIterator
from socket import SOCK_DGRAM
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.real.rig import Rig
from tests.real.scenario import scenario
from tests.real.sockets import Address, Socket
from tests.support.ports import free_port

WORSE: Final = 0.01
"""Maximum loss of IoU of a real flight's map against that of the simulated one."""


async def complete(rig: Rig, *words: object) -> None:
    """Fly a mission to its end, and the same one in the bundled simulator."""
    run = await rig.fly("--auto-swap", *words)
    await rig.ends_well(run, 0, within_s=1800.0)
    assert rig.referee.breaches == 0
    # the error of a real position decides whether a cell that is half region is missed
    simulated = await rig.fly_simulated(*words)
    assert rig.row.iou is not None
    assert rig.row.iou >= simulated - WORSE


async def begun(rig: Rig, *words: object, for_s: float = 60.0) -> None:
    run = await rig.fly("--auto-swap", *words)
    await rig.in_search(run)
    await rig.rest(for_s)
    await rig.comes_home(run)
    assert rig.referee.breaches == 0


@contextlib.asynccontextmanager
async def busy() -> AsyncIterator[None]:
    cores = max(1, (os.cpu_count() or 2) // 2)
    others = [
        await asyncio.create_subprocess_exec(sys.executable, "-c", "while True: pass")
        for _ in range(cores)
    ]
    try:
        yield
    finally:
        for one in others:
            one.kill()
            await one.wait()


@scenario("runway")
async def test_runway_is_complete(rig: Rig) -> None:
    await complete(rig)


@scenario("runway, searched from on high", shipped=True)
async def test_runway_is_complete_from_on_high(rig: Rig) -> None:
    await complete(rig)


@scenario("runway, half of the computer busy")
async def test_runway_is_complete_beside_a_busy_process(rig: Rig) -> None:
    async with busy():
        await complete(rig)


@scenario("runway at 3 m/s", speed_m_s=3.0)
async def test_runway_at_3_m_s_begins_well(rig: Rig) -> None:
    await begun(rig)


@scenario("burn", "burn")
async def test_burn_is_complete_with_swaps(rig: Rig) -> None:
    await complete(rig)


@scenario("spill, three aircraft", "spill")
async def test_spill_is_complete_with_three(rig: Rig) -> None:
    await complete(rig)
    assert math.isfinite(rig.referee.judge.nearest_m), "no two vehicles were compared in the air"
    assert rig.referee.judge.nearest_m > rig.mission.team.separation_m


@scenario("--driver mavsdk")
async def test_mavsdk_begins_well(rig: Rig) -> None:
    await begun(rig, "--driver", "mavsdk")


@scenario("--strategy rdfs")
async def test_rdfs_begins_well(rig: Rig) -> None:
    await begun(rig, "--strategy", "rdfs")


@scenario("--strategy survey")
async def test_survey_begins_well(rig: Rig) -> None:
    await begun(rig, "--strategy", "survey")


class _GroundStation:
    def __init__(self) -> None:
        self.kinds: set[str] = set()
        self.socket = Socket(self._receive)
        self._in, self._out = mav.MAVLink(None), mav.MAVLink(None, srcSystem=250)
        self._in.robust_parsing = True

    def _receive(self, data: bytes, address: Address) -> None:
        for message in self._in.parse_buffer(data) or ():
            if message.get_type() not in self.kinds and message.get_type() == "HEARTBEAT":
                ask = mav.MAVLink_param_request_list_message(message.get_srcSystem(), 1)
                self.socket.send(ask.pack(self._out), address)
            self.kinds.add(message.get_type())


@scenario("--forward")
async def test_ground_station_beside_the_service_is_served(rig: Rig) -> None:
    port, station = free_port(SOCK_DGRAM), _GroundStation()
    await station.socket.open(port)
    await begun(rig, "--forward", f"udpout://127.0.0.1:{port}", for_s=20.0)
    station.socket.close()
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "PARAM_VALUE"} <= station.kinds
