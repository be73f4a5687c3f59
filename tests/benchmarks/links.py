"""What the links cost: `python -m tests.benchmarks.links`.

* From a picture's votes to the next target on the wire: journal, reducer and driver, wall time.
* Twenty vehicles at 10 Hz: the part of one core that hearing them takes, plain, signed, and passed
  on to a ground station.
"""

from __future__ import annotations

import asyncio
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Event, FrameSeen
from missions.orders import TakeOff
from tests.support.flights import Flight, fly, small_mission
from tests.support.plans import plan_of
from uavmap.base.clock import VirtualClock, run
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.mavlink.links.forwarding import Forwarding
from uavmap.mavlink.links.framing import Splitter
from uavmap.mavlink.links.signing import Signing, Stream
from uavmap.mavlink.session import Session
from uavmap.runner import flight as flight_module
from uavmap.runner.service import Service

VEHICLES = 20
SECONDS = 20.0
KEY = bytes(range(32))


class _Memory:
    def __init__(self) -> None:
        self.sent = 0
        self.heard: dict[Stream, int] = {}

    def note(self) -> None:
        pass


def frame_to_target_s(mission: str = "speck") -> list[float]:
    """Wall seconds from votes that end a look to the target that follows, of a whole flight."""
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

    text = (Path(__file__).parents[1] / "data" / f"{mission}.toml").read_text()
    plan = plan_of(
        mission_source=mission, mission=text, strategy=None, vehicles=None, seed=1,
        urls=(), speedup=None, epoch_utc_s=SIM_EPOCH_UTC_S,
    )  # fmt: skip
    Service.post, Session.send = noted, sent  # type: ignore[method-assign]
    try:
        with tempfile.TemporaryDirectory() as folder:
            flight_module.fly(plan, Path(folder) / "out")
    finally:
        Service.post, Session.send = post, send  # type: ignore[method-assign]
    return found


def telemetry() -> list[tuple[float, bytes]]:
    """What a vehicle in the air says at the rates that a flight asks for."""
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
    """The part of a core that it takes to hear so many vehicles."""
    pieces = heard
    if signed:
        vehicle = Signing(KEY, _Memory())
        pieces = [(at, b"".join(map(vehicle.sign, Splitter().feed(data)))) for at, data in heard]

    async def main() -> float:
        flights = [Flight(small_mission()) for _ in range(VEHICLES)]
        forwarding = Forwarding(lambda frame: None)
        for each in flights:
            each.session.signing = Signing(KEY, _Memory()) if signed else None
            if forwarded:
                each.session.tap = forwarding.add(_Way())
        forwarding._stations.append(_Nobody())
        begin_s = time.process_time()
        loop = asyncio.get_running_loop()
        for at_s, data in pieces:
            await asyncio.sleep(max(at_s - loop.time(), 0.0))
            for each in flights:
                each.session.feed(data)
        return (time.process_time() - begin_s) / SECONDS

    return run(main(), VirtualClock())


class _Nobody:
    peer_host = None
    way = None

    def send(self, data: bytes) -> None:
        pass


class _Way:
    system_id = 1
    transport = _Nobody()


def main() -> None:
    """Measure, and print."""
    found_ms = sorted(1000.0 * s for s in frame_to_target_s())
    print(
        f"frame to target, {len(found_ms)} targets: median {statistics.median(found_ms):.1f} ms, "
        f"at most {found_ms[-1]:.1f} ms"
    )
    heard = telemetry()
    frames = sum(len(Splitter().feed(data)) for _, data in heard)
    positions = sum(
        message.get_msgId() == mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        for message in mav.MAVLink(None).parse_buffer(b"".join(data for _, data in heard)) or ()
    )
    print(f"a vehicle: {frames / SECONDS:.1f} frames/s, {positions / SECONDS:.1f} positions/s")
    for signed in (False, True):
        for forwarded in (False, True):
            share = core_share(heard, signed=signed, forwarded=forwarded)
            words = [word for word, on in (("signed", signed), ("forwarded", forwarded)) if on]
            print(f"{VEHICLES} vehicles{''.join(', ' + w for w in words)}: {share:.2f} of a core")


if __name__ == "__main__":
    main()
