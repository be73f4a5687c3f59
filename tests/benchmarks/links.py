"""Cost of the links: `python -m tests.benchmarks.links`.

* From a picture's votes to the next target on the wire: journal, reducer and driver, wall time.
* Twenty vehicles at 10 Hz: the share of one core for reception, plain, signed, and forwarded to a
  ground station.
"""

from __future__ import annotations

import asyncio
import itertools
import time
from types import SimpleNamespace
from typing import Any
from unittest import mock

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Event, FrameSeen
from missions.orders import TakeOff
from tests.benchmarks.frame import spread, summary_of
from tests.e2e.rig import mission
from tests.support.flights import Flight, fly, small_mission
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.links.forwarding import Forwarding
from uavmap.mavlink.links.framing import Splitter
from uavmap.mavlink.links.signing import Signing
from uavmap.mavlink.session import Session
from uavmap.runner.service import Service

VEHICLES = 20
SECONDS = 20.0
KEY = bytes(range(32))


def _memory() -> Any:
    """Return the memory of a link for signatures, without a file."""
    return SimpleNamespace(sent=0, heard={}, note=lambda: None)


def frame_to_target_s(name: str = "speck") -> list[float]:
    """Return wall seconds from votes that end a look to the next target, of a whole flight."""
    found: list[float] = []
    posted_s = [float("inf")]
    post, send = Service.post, Session.send

    def noted(self: Service, event: Event) -> None:
        if isinstance(event, FrameSeen):
            posted_s[0] = time.perf_counter()
        post(self, event)

    def sent(self: Session, message: Any) -> None:
        send(self, message)
        if message.get_type() == "COMMAND_INT" and posted_s[0] < float("inf"):
            found.append(time.perf_counter() - posted_s[0])
            posted_s[0] = float("inf")

    changed = mock.patch.object(Service, "post", noted), mock.patch.object(Session, "send", sent)
    with changed[0], changed[1]:
        summary_of(mission(name))
    return found


def telemetry() -> list[tuple[float, bytes]]:
    heard: list[tuple[float, bytes]] = []

    async def body(flight: Flight) -> None:
        await flight.after(TakeOff(12.0), Airborne)
        feed = flight.session.feed
        begin_s = flight.now_s()

        def noted(data: bytes) -> bool:
            heard.append((flight.now_s() - begin_s, data))
            return feed(data)

        flight.session.feed = noted  # type: ignore[method-assign]
        await asyncio.sleep(SECONDS)

    fly(body)
    return heard


def core_share(heard: list[tuple[float, bytes]], *, signed: bool, forwarded: bool) -> float:
    pieces = heard
    if signed:
        vehicle = Signing(KEY, _memory())
        pieces = [(at, b"".join(map(vehicle.sign, Splitter().feed(data)))) for at, data in heard]

    async def main() -> float:
        flights = [Flight(small_mission()) for _ in range(VEHICLES)]
        forwarding = Forwarding(lambda frame: None)
        for each in flights:
            each.session.signing = Signing(KEY, _memory()) if signed else None
            if forwarded:
                each.session.tap = forwarding.add(SimpleNamespace(system_id=1))
        forwarding._stations.append(SimpleNamespace(send=lambda data: None))
        begin_s = time.process_time()
        loop = asyncio.get_running_loop()
        for at_s, data in pieces:
            await asyncio.sleep(max(at_s - loop.time(), 0.0))
            for each in flights:
                each.session.feed(data)
        return (time.process_time() - begin_s) / SECONDS

    return run(main(), VirtualClock())


def main() -> None:
    found_ms = [1000.0 * s for s in frame_to_target_s()]
    print(f"frame to target, {len(found_ms)} targets, ms: {spread(found_ms)}")
    heard = telemetry()
    frames = sum(len(Splitter().feed(data)) for _, data in heard)
    positions = sum(
        message.get_msgId() == mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        for message in mav.MAVLink(None).parse_buffer(b"".join(data for _, data in heard)) or ()
    )
    print(f"a vehicle: {frames / SECONDS:.1f} frames/s, {positions / SECONDS:.1f} positions/s")
    for signed, forwarded in itertools.product((False, True), repeat=2):
        share = core_share(heard, signed=signed, forwarded=forwarded)
        words = ", signed" * signed + ", forwarded" * forwarded
        print(f"{VEHICLES} vehicles{words}: {share:.2f} of a core")


if __name__ == "__main__":
    main()
