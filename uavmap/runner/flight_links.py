"""The links of a flight: opened together, signed with one key, shared by vehicles and stations."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from missions.errors import LinkError
from missions.mission.schema import CameraSection, Mission
from uavmap.aircraft.cameras.mavlink import Fetch, MavlinkSource
from uavmap.aircraft.cameras.opening import Settings, opened_camera
from uavmap.aircraft.cameras.pose import Mount
from uavmap.aircraft.cameras.source import FrameSource
from uavmap.aircraft.cameras.spec import CameraSpec, parse_camera
from uavmap.aircraft.imaging.http_pictures import PictureFetcher
from uavmap.base import messages
from uavmap.journal.flight_plan import MAVSDK, FlightOptions
from uavmap.mavlink.links.forwarding import Forwarding
from uavmap.mavlink.links.signing import signing_with
from uavmap.mavlink.links.transports import Transport, open_shared, open_transport
from uavmap.mavlink.links.urls import Endpoint, parse_url
from uavmap.mavlink.mavsdk.mavsdk_session import opened_session
from uavmap.mavlink.session import ACK_WAIT_S, Session

ACK_WAIT_WALL_S: Final = 0.3
"""Time that a busy machine takes to answer on a fast clock, real seconds."""


@dataclass(frozen=True, slots=True)
class Link:
    """The link to one aircraft, and its camera."""

    name: str
    """Name for the operator: its URL."""
    session: Session
    camera: FrameSource


def mavlink_link(name: str, session: Session, fetch: Fetch) -> Link:
    """Return a link whose camera is commanded by MAVLink messages of its session."""
    return Link(name, session, MavlinkSource(session, fetch))


class _Line:
    """A session, and its transport once that is open."""

    def __init__(self, endpoint: Endpoint, record: Callable[[bytes], None], wait_s: float) -> None:
        self.endpoint = endpoint
        self.opened: Transport | None = None
        self.session = Session(self.send, record, wait_s)

    def send(self, frame: bytes) -> None:
        """Send a frame; drop it before the transport is open."""
        if self.opened is not None:
            self.opened.send(frame)

    @property
    def transport(self) -> Transport:
        """Open transport."""
        assert self.opened is not None
        return self.opened

    @property
    def system_id(self) -> int:
        """System id of the other end, 0 until it has sent."""
        return self.session.view.system_id

    def hosts(self, named: Sequence[str]) -> tuple[str, ...]:
        """Return the hosts of its vehicle's pictures; its peer is known once it has sent."""
        return (*named, self.transport.peer_host or "")


@contextlib.asynccontextmanager
async def opened_links(
    options: FlightOptions,
    cameras: Sequence[CameraSpec],
    section: CameraSection,
    record: Callable[[bytes], None],
) -> AsyncIterator[list[Link]]:
    """Open a signed link to every URL of the options, in order, and the stations of `forward`.

    `cameras` are one a link, `section` is for all of them. `record` receives every frame. Raises
    `LinkError` if a link or a camera cannot be opened.
    """
    urls, speedup = options.urls, options.speedup or 1.0
    log = messages.bound("uavmap.mavlink").line
    wait_s = max(ACK_WAIT_S, ACK_WAIT_WALL_S * speedup)
    lines = [_Line(parse_url(url), record, wait_s) for url in urls]
    forwarding = Forwarding(record)
    async with contextlib.AsyncExitStack() as stack:
        number = secrets.randbelow(2**32 - 1) + 1
        signing = stack.enter_context(signing_with(options.key_file))
        for url, line in zip(urls, lines, strict=True):
            if options.driver == MAVSDK:
                speaks = partial(log_with, log, url)
                line.session = await stack.enter_async_context(
                    opened_session(line.send, record, wait_s, speaks, speedup)
                )
            line.session.view.wanted_system = line.endpoint.system
            line.session.signing = signing
            line.session.onboard = options.onboard
            line.session.process_number = number
            if options.forward:
                line.session.tap = forwarding.add(line)
        check_urls(urls)
        ports: dict[Endpoint, list[_Line]] = {}
        for line in lines:
            ports.setdefault(line.endpoint.port_of_all, []).append(line)
        for shared in ports.values():
            await _open(stack, shared, log)
        await stack.enter_async_context(forwarding.open(options.forward, log))
        size_px = (section.width_px, section.height_px)
        settings = Settings(size_px, section.interval_s, section.latency_s, mount_of(section))
        links: list[Link] = []
        for url, line, spec in zip(urls, lines, cameras, strict=True):
            fetch = PictureFetcher(partial(line.hosts, section.hosts))
            camera = await stack.enter_async_context(
                opened_camera(spec, line.session, fetch, settings, log)
            )
            links.append(Link(url, line.session, camera))
        yield links
        for number, line in enumerate(lines, start=1):
            for (kind, reason), count in sorted(line.session.view.gate.refused.items()):
                if kind == "frames":
                    log(f"vehicle {number}: {count} frames were refused: {reason}")


def log_with(log: Callable[[str], None], name: str, text: str) -> None:
    """Log a line about one link, or one vehicle."""
    log(f"{name}: {text}")


def check_urls(urls: Sequence[str]) -> None:
    """Raise `LinkError` for URLs that cannot be flown together, before anything is opened."""
    ports: dict[Endpoint, list[int | None]] = {}
    for endpoint in map(parse_url, urls):
        ports.setdefault(endpoint.port_of_all, []).append(endpoint.system)
    for port, systems in ports.items():
        if len(systems) > 1 and (None in systems or len(set(systems)) < len(systems)):
            raise LinkError(
                f"{port.url} is given {len(systems)} times; add the vehicle to each: "
                f"{port.url}?system=1, {port.url}?system=2"
            )


async def reject_other_controllers(links: Sequence[Link], listen_s: float) -> None:
    """Raise `LinkError` if another uavmap is received within `listen_s` of a vehicle's first
    frame."""
    loop = asyncio.get_running_loop()
    for link in links:
        session = link.session
        left_s = (session.bound_s or loop.time()) + listen_s - loop.time()
        if await session.until(session.has_rival, max(left_s, 1e-3)):
            raise LinkError(
                f"{link.name}: another uavmap flies this vehicle already; end that one first "
                "(Ctrl-C there), or wait until it is done"
            )


async def _open(
    stack: contextlib.AsyncExitStack, shared: Sequence[_Line], log: Callable[[str], None]
) -> None:
    first = shared[0]
    if len(shared) == 1:
        alone = open_transport(first.endpoint, first.session.feed, log)
        first.opened = await stack.enter_async_context(alone)
        return
    takers = {line.endpoint.system or 0: line.session.feed for line in shared}
    together = open_shared(first.endpoint.port_of_all, takers, log)
    transports = await stack.enter_async_context(together)
    for line in shared:
        line.opened = transports[line.endpoint.system or 0]


# --- cameras, as the mission file and the command line describe them --------------------------
def mount_of(camera: CameraSection) -> Mount:
    """Return the mounting of a mission file's camera on its aircraft."""
    return Mount(camera.mounting == "fixed", camera.yaw_deg, camera.pitch_deg, camera.roll_deg)


def cameras_of(
    given: Sequence[str], mission: Mission, member: int | None = None
) -> list[CameraSpec]:
    """Return each vehicle's, or a member's, camera: as given, else the mission's.

    Raises `LinkError`.
    """
    ours = mission.vehicles if member is None else mission.vehicles[member - 1 : member]
    written = given or [v.camera or "mavlink" for v in ours]
    return [parse_camera(text) for text in written]
