"""Whole flights in the simulator with pictures from other sources than its own camera."""

import asyncio
import contextlib
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import FrameLost, FrameSeen
from missions.flight.setting_of import setting_of
from tests.support.flights import small_mission
from tests.support.plans import plan_of
from tests.support.shown_lines import ShownLines
from tests.unit.uavmap.aircraft.cameras.conformance import inline, running
from uavmap.aircraft.cameras.folder import FolderSource
from uavmap.aircraft.cameras.pose import Mount
from uavmap.aircraft.cameras.source import FrameSource
from uavmap.aircraft.cameras.triggered import TriggeredSource
from uavmap.base.messages import shown_on
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, SIM_EPOCH_UTC_S
from uavmap.mavlink.session import Session
from uavmap.runner.flight_links import Link
from uavmap.runner.one_flight import Flight
from uavmap.runner.simulation import Simulation

LATENCY_S = 0.35
INTERVAL_S = 0.4
_APP1 = 0xE1


def bare(jpeg):
    """Return the same picture without the tags for its time and place."""
    out, at = bytearray(jpeg[:2]), 2
    while jpeg[at + 1] != 0xDA:
        (length,) = struct.unpack(">H", jpeg[at + 2 : at + 4])
        if jpeg[at + 1] != _APP1:
            out += jpeg[at : at + 2 + length]
        at += 2 + length
    return bytes(out + jpeg[at:])


class Card:
    def __init__(self, simulation, session, folder):
        self._simulation = simulation
        self._folder = folder
        session.listen(self._on_message)

    def _on_message(self, message):
        if message.get_type() == "CAMERA_IMAGE_CAPTURED":
            loop = asyncio.get_running_loop()
            loop.call_later(LATENCY_S, self._write, message.image_index, message.file_url)

    def _write(self, index, url):
        data = self._simulation._vehicles[0].image(url)
        (self._folder / f"DSC{index:05}.JPG").write_bytes(bare(data))

    async def shoot(self):
        """Take pictures all the time, like a camera with an interval timer."""
        codec = mav.MAVLink(None, 255, 190)
        start = mav.MAVLink_command_long_message(
            1, 100, mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, INTERVAL_S, 0, 0, 0, 0, 0
        )
        while True:
            self._simulation._vehicles[0].receive(start.pack(codec))
            await asyncio.sleep(5.0)


Rig = Callable[
    [Simulation, Session, Path, list[str]], contextlib.AbstractAsyncContextManager[FrameSource]
]


class RiggedFlight(Flight):
    def __init__(self, rig, said, *how):
        super().__init__(*how)
        self.rig, self.said = rig, said

    async def _fly_simulated(self):
        simulation = Simulation(self.setting, self._plan.seed)
        session = simulation.open_session(0, lambda frame: None)
        card = self.folder / "card"
        card.mkdir()
        async with asyncio.TaskGroup() as tasks:
            world = tasks.create_task(simulation.run())
            async with self.rig(simulation, session, card, self.said) as source:
                link = Link("sim", session, source)
                await self._serve(self._here([link]))
            world.cancel()
        return simulation.truth


def fly_mission(rig, made, folder):
    plan = plan_of("m.toml", made, None, None, 1, (), None, SIM_EPOCH_UTC_S)
    setting, lines = setting_of(made), ShownLines()
    folder.mkdir()
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json()}) as journal:
        flight = RiggedFlight(rig, lines, plan, folder, journal, setting.initial_state())
        with shown_on(lines):
            return flight.run(), list(journal.events()), lines


def mission(latency_s=LATENCY_S, **how):
    made = small_mission(interval_s=INTERVAL_S, **how)
    camera = made.camera.model_copy(update={"latency_s": latency_s})
    return made.model_copy(update={"camera": camera})


@contextlib.asynccontextmanager
async def folder(simulation, session, card, said):
    """Fill a folder with pictures; only the autopilot reports where they were taken."""
    source = FolderSource(card, LATENCY_S, said.append, inline)
    await source.begin()
    writer = Card(simulation, session, card)
    async with running(source.run), running(writer.shoot):
        yield source


@contextlib.asynccontextmanager
async def triggered(simulation, session, card, said):
    """Have the autopilot trigger and report; the pictures arrive in a folder."""
    source = TriggeredSource(session, Mount(), card, LATENCY_S, said.append, inline)
    await source.begin()
    Card(simulation, session, card)
    async with running(source.run):
        yield source


@pytest.mark.parametrize("rig", [folder, triggered], ids=lambda rig: rig.__name__)
def test_flight_without_stopping_maps_the_region(rig, tmp_path):
    """The moving camera tilts: poses of another moment would shift the map."""
    summary, events, said = fly_mission(rig, mission(strategy="swath"), tmp_path / "flight")
    assert summary["completed"], said
    assert summary["cells_missed"] == 0
    assert summary["iou_cells"] == 1.0
    assert len([e for e in events if isinstance(e, FrameSeen)]) >= 20
    assert not [e for e in events if isinstance(e, FrameLost)]
    assert not any("refused" in line for line in said)
