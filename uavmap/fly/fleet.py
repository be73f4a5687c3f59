"""The aircraft of a flight: a link to each, and the vehicle of the mission at its other end."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from missions.errors import LinkError
from missions.state import Setting
from uavmap.fly.classifier import Classifier
from uavmap.fly.ground_crew import Crew
from uavmap.fly.http_pictures import PictureFetcher
from uavmap.fly.imaging import CameraDriver, Fetch
from uavmap.fly.reporter import BATTERY_STALE_S
from uavmap.fly.vehicle import LINK_LOST_S, ON_GROUND_S, MavlinkVehicle
from uavmap.link.identity import same_aircraft
from uavmap.link.session import ACK_WAIT_S, Session
from uavmap.link.transports import Transport, open_transport
from uavmap.link.urls import parse_url
from uavmap.mavsdk_driver.session import opened_session
from uavmap.record.flight_plan import MAVSDK, PYMAVLINK, FlightPlan

LINK_LOST_WALL_S: Final = 2.0
BATTERY_STALE_WALL_S: Final = 5.0
SLACK_WALL_S: Final = 2.0
"""On a clock that runs fast, a busy machine must not look like an aircraft in trouble."""
STREAMED_SPEEDUP: Final = 3.0
"""On a faster clock a stream's timeout, a second of the vehicle's time, is so short that any busy
machine misses it: places ahead are told instead, at which a vehicle stops."""
ACK_WAIT_WALL_S: Final = 0.3


@dataclass(frozen=True, slots=True)
class Link:
    """The way to one aircraft, and to the pictures of its camera."""

    name: str
    """What the operator calls it: its URL."""
    session: Session
    fetch: Fetch


@contextlib.asynccontextmanager
async def opened_links(
    plan: FlightPlan,
    setting: Setting,
    record: Callable[[bytes], None],
    say: Callable[[str], None],
) -> AsyncIterator[list[Link]]:
    """A link to every URL of a plan, in their order, open until the end of the context.

    `record` is given every frame, `say` a line for the operator. Raises `LinkError` where one
    cannot be opened.
    """
    hosts = setting.mission.camera.hosts
    async with opened_sessions(
        plan.urls, hosts, plan.speedup, record, say, driver=plan.driver
    ) as links:
        yield links


@contextlib.asynccontextmanager
async def opened_sessions(
    urls: Sequence[str],
    named: Sequence[str],
    speedup: float | None,
    record: Callable[[bytes], None],
    say: Callable[[str], None],
    *,
    driver: str = PYMAVLINK,
) -> AsyncIterator[list[Link]]:
    """`opened_links` without a plan; `named` are the hosts that pictures may come from."""
    speedup = speedup or 1.0
    ack_wait_s = max(ACK_WAIT_S, ACK_WAIT_WALL_S * speedup)
    async with contextlib.AsyncExitStack() as stack:
        links: list[Link] = []
        for url in urls:
            session, transport = await stack.enter_async_context(
                _connected(url, record, ack_wait_s, say, driver, speedup)
            )
            # the peer is known only when it has spoken
            hosts = partial(_hosts, named, transport)
            links.append(Link(url, session, PictureFetcher(hosts)))
        yield links


def _hosts(named: Sequence[str], transport: Transport) -> tuple[str, ...]:
    """Where the pictures of the vehicle at the other end of a link may come from."""
    return (*named, transport.peer_host or "")


@contextlib.asynccontextmanager
async def _connected(
    url: str,
    record: Callable[[bytes], None],
    ack_wait_s: float,
    say: Callable[[str], None],
    driver: str,
    speedup: float,
) -> AsyncIterator[tuple[Session, Transport]]:
    """A session of a driver over the transport that a URL names."""
    opened: list[Transport] = []

    def send(frame: bytes) -> None:
        for transport in opened:
            transport.send(frame)

    async with contextlib.AsyncExitStack() as stack:
        session = Session(send, record, ack_wait_s)
        if driver == MAVSDK:
            session = await stack.enter_async_context(
                opened_session(send, record, ack_wait_s, partial(_say_of_link, say, url), speedup)
            )
        transport = await stack.enter_async_context(
            open_transport(parse_url(url), session.feed, say)
        )
        opened.append(transport)
        yield session, transport


def _say_of_link(say: Callable[[str], None], url: str, text: str) -> None:
    """A line about one link."""
    say(f"{url}: {text}")


def vehicles_of(
    plan: FlightPlan,
    setting: Setting,
    links: Sequence[Link],
    crew: Crew,
    mission_time_s: Callable[[], float],
    say: Callable[[str], None],
) -> dict[int, MavlinkVehicle]:
    """The vehicle at the end of each link, by its number in the mission, from 1."""
    at_a_terminal = not (crew.absent or plan.simulated or plan.auto_swap)
    speedup = max(plan.speedup or 1.0, 1.0)
    # on a clock that runs fast, a busy machine must not look like a lost link
    link_lost_s, stale_s, slack_s = LINK_LOST_S, BATTERY_STALE_S, 0.0
    if not plan.simulated:
        link_lost_s = max(link_lost_s, LINK_LOST_WALL_S * (plan.speedup or 1.0))
        stale_s = max(stale_s, BATTERY_STALE_WALL_S * speedup)
        slack_s = SLACK_WALL_S * (speedup - 1.0)
    vehicles = {}
    for number, link in enumerate(links, start=1):
        view = link.session.view
        view.expect_near(setting.mission.home)
        view.gate.say = partial(_say_of, say, number)
        altitude_m = setting.mission.altitude_m(number - 1)
        classifier = Classifier.of(setting.mission, setting.grid, altitude_m)
        vehicles[number] = MavlinkVehicle(
            number,
            link.name,
            link.session,
            CameraDriver(number, link.session, classifier, link.fetch, mission_time_s),
            setting,
            mission_time_s,
            crew.swap,
            link_lost_s,
            battery_stale_s=stale_s,
            ground_patience_s=None if at_a_terminal else ON_GROUND_S,
            slack_s=slack_s,
            by_places=not plan.simulated and speedup > STREAMED_SPEEDUP,
            tell=say,
        )
    return vehicles


def _say_of(say: Callable[[str], None], number: int, text: str) -> None:
    """A line about one vehicle."""
    say(f"vehicle {number}: {text}")


def each_its_own(vehicles: Mapping[int, MavlinkVehicle]) -> None:
    """Raise `LinkError` where two links lead to one aircraft: it would be told two things at once.

    Seen after both have answered; a router that forwards several vehicles may do that.
    """
    for (_, one), (_, other) in itertools.combinations(vehicles.items(), 2):
        if same_aircraft(one.view, other.view):
            raise LinkError(
                f"{one.name} and {other.name} lead to the same aircraft (system "
                f"{one.view.system_id}); give every vehicle a link and a system id of its own"
            )
