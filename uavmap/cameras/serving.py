"""`uavmap camera` at work: a link, a source and a web server, put together."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass

from missions.errors import LinkError
from uavmap.cameras.component import CameraComponent, CameraFacts
from uavmap.cameras.folder import Say
from uavmap.cameras.local import LocalSource
from uavmap.cameras.opening import Settings, opened_camera
from uavmap.cameras.picture_server import PictureStore, served
from uavmap.cameras.pose import Poses
from uavmap.cameras.spec import CameraSpec
from uavmap.link.session import Session
from uavmap.link.transports import Transport, open_transport
from uavmap.link.urls import Endpoint

UNHEARD_S = 10.0


@dataclass(frozen=True, slots=True)
class CameraPlan:
    """What `uavmap camera` was told."""

    endpoint: Endpoint
    spec: CameraSpec
    host: str
    port: int
    settings: Settings
    hfov_deg: float
    component: int


async def serve_camera(plan: CameraPlan, say: Say) -> None:
    """Be a MAVLink camera until cancelled. Raises `LinkError`."""
    opened: list[Transport] = []

    def send(frame: bytes) -> None:
        for transport in opened:
            transport.send(frame)

    session = Session(send, lambda frame: None)
    session.view.gate.say = say
    settings, store = plan.settings, PictureStore()
    poses = Poses(session, settings.mount, None)
    facts = CameraFacts(settings.size_px, plan.hfov_deg, plan.spec.text)
    async with contextlib.AsyncExitStack() as stack:
        source = await stack.enter_async_context(
            opened_camera(plan.spec, session, _fetches_nothing, settings, say)
        )
        if not isinstance(source, LocalSource):
            raise LinkError(f"{plan.spec.text}: is a camera of the autopilot already")
        port = await stack.enter_async_context(served(store, plan.host, plan.port))
        host = f"[{plan.host}]" if ":" in plan.host else plan.host
        component = CameraComponent(
            session, send, source, poses, facts, store,
            lambda path: f"http://{host}:{port}{path}", plan.component,
        )  # fmt: skip
        opened.append(
            await stack.enter_async_context(open_transport(plan.endpoint, session.feed, say))
        )
        say(f"{plan.spec.text} is open; pictures at http://{host}:{port}/; no autopilot heard yet")
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(component.run())
            tasks.create_task(_tell(session, component, say))


async def _fetches_nothing(url: str) -> bytes:
    raise LinkError(f"{url}: nothing is fetched")


async def _tell(session: Session, component: CameraComponent, say: Say) -> None:
    """A line when the autopilot is heard first, and one with the count now and then."""
    await session.until(lambda: session.view.autopilot is not None)
    say(f"part of aircraft {session.view.system_id}: a camera, waiting for orders")
    told = 0
    while True:
        await asyncio.sleep(UNHEARD_S)
        if component.taken != told:
            told = component.taken
            say(f"{told} pictures taken")
