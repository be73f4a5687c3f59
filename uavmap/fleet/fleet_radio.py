"""The entry of a member with a real vehicle into its fleet: its radio, its seal, its messages."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Final

from missions.errors import LinkError
from missions.mission.schema import Mission
from uavmap.fleet.member import BEAT_S, Member
from uavmap.fleet.radio import (
    FleetEndpoint,
    MulticastRadio,
    Radio,
    Radios,
    SealedRadio,
    parse_endpoint,
)
from uavmap.fleet.sealing import Seal, fleet_key
from uavmap.fleet.zenoh_radio import ZenohLinks, ZenohRadio, imported_zenoh
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import FleetNetwork, FlightPlan
from uavmap.mavlink.links.signing import read_key

REFUSAL_HINTS: Final = {
    "not sealed with our key": " (another --fleet-key, or another mission file, or a stranger)",
    "from another with our number": " (give every vehicle a number of its own with --vehicle)",
    "damaged": "",
}
_LOG: Final = logging.getLogger("uavmap.fleet")
START: Final = "fleet_start"
"""Key of the journal's meta: the number of the member's latest start."""


@contextlib.asynccontextmanager
async def joined_fleet(
    plan: FlightPlan, mission: Mission, journal: Journal
) -> AsyncIterator[SealedRadio | None]:
    """Yield the radio of a member and its seal; None without a fleet, or without a connection.

    Raises `LinkError`, `JournalError`.
    """
    network = plan.network
    if plan.member is None or network is None or network.alone:
        if plan.member is not None:
            _LOG.info("no --listen, --peer or --router: running without fleet communication")
        yield None
        return
    seal = member_seal(network, mission, plan.member, journal)
    async with opened_radio(network, mission) as radio:
        yield SealedRadio(radio, seal)
    for reason, count in sorted(seal.refused.items()):
        if reason in REFUSAL_HINTS:
            _LOG.info(f"{count} datagrams were refused: {reason}{REFUSAL_HINTS[reason]}")


def check_network(network: FleetNetwork | None) -> None:
    """Raise `LinkError` for parts that cannot be opened, before any is: endpoints, key, Zenoh."""
    if network is None:
        return
    groups, links = _endpoints(network)
    if network.key_file is None and not network.alone:
        raise LinkError(
            "--fleet-key FILE is missing: only holders of the fleet's key are accepted; "
            "`uavmap keys new FILE` makes one, every vehicle gets a copy"
        )
    if groups or links.all:
        read_key(Path(network.key_file or ""))
    if links.all:
        imported_zenoh()


def member_seal(
    network: FleetNetwork,
    mission: Mission,
    number: int,
    journal: Journal,
    now_utc_s: Callable[[], float] = time.time,
) -> Seal:
    """Return the seal of a member at a new start.

    It is higher than any before, also by a clock set back. The journal holds it before it is used.
    Raises `LinkError` for the key, `JournalError`.
    """
    start = max(int(journal.meta.get(START, 0)) + 1, int(now_utc_s()))
    journal.put_meta(START, start)
    key = fleet_key(read_key(Path(network.key_file or "")), mission)
    return Seal(key, number, start)


@contextlib.asynccontextmanager
async def opened_radio(network: FleetNetwork, mission: Mission) -> AsyncIterator[Radio]:
    """Yield the radio of a network, open until the end of the context. Raises `LinkError`."""
    groups, links = _endpoints(network)
    parts: list[Radio] = []
    async with contextlib.AsyncExitStack() as stack:
        for group in groups:
            by_group = MulticastRadio(group)
            by_group.open()
            stack.callback(by_group.close)
            parts.append(by_group)
        if links.all:
            by_zenoh = ZenohRadio(links, key_expression(mission.name))
            by_zenoh.open()
            stack.push_async_callback(by_zenoh.close)
            parts.append(by_zenoh)
        yield parts[0] if len(parts) == 1 else Radios(parts)


def key_expression(name: str) -> str:
    """Return the key under which the members of a mission publish and subscribe.

    >>> key_expression("north field #2")
    'uavmap/north-field--2'
    """
    return "uavmap/" + (re.sub(r"[^A-Za-z0-9_-]", "-", name)[:40] or "mission")


def _endpoints(network: FleetNetwork) -> tuple[list[FleetEndpoint], ZenohLinks]:
    """Return the multicast groups, and the links for Zenoh. Raises `LinkError`."""
    listen = [parse_endpoint("--listen", text) for text in network.listen]
    groups = [endpoint for endpoint in listen if endpoint.multicast]
    links = ZenohLinks(
        tuple(endpoint for endpoint in listen if not endpoint.multicast),
        tuple(parse_endpoint("--peer", text) for text in network.peers),
        tuple(parse_endpoint("--router", text) for text in network.routers),
    )
    if links.routers and (links.listen or links.peers):
        raise LinkError(
            "--router carries all there is: leave out --peer and --listen (a multicast group may "
            "stand beside it)"
        )
    return groups, links


# --- the talk ------------------------------------------------------------------------------------
LINGER_S: Final = 600.0
"""Time after its landing that a member waits for others that still fly..."""
LINGER_APART_S: Final = 120.0
"""Same, for those that are out of contact."""


@contextlib.asynccontextmanager
async def fleet_communication(
    member: Member | None, *, may_leave: bool = False
) -> AsyncIterator[None]:
    """Let a member communicate in the context, and after it until the others know all of it.

    With `may_leave` an operator may end that wait; its cancellation is no failure.
    """
    if member is None:
        yield
        return
    task = asyncio.create_task(member.run())
    try:
        yield
        if may_leave and not member.level:
            _LOG.info(
                "this vehicle is done; waiting for the others' last facts (Ctrl-C ends the wait)"
            )
        try:
            await _settle(member)
        except asyncio.CancelledError:
            waiting = asyncio.current_task()
            if not may_leave or waiting is None:
                raise
            waiting.uncancel()
            _LOG.info(
                "not waiting for the others: their journals hold what they find, for uavmap merge"
            )
    finally:
        task.cancel()
        member.end()
        await asyncio.gather(task, return_exceptions=True)


async def _settle(member: Member) -> None:
    """Wait, within bounds, until all in contact are done and know all facts of this member.

    A member out of contact that was not done returns, and then receives our messages.
    """
    waited_s = 0.0
    while waited_s < LINGER_S:
        least_s = 2.0 * BEAT_S if member.all_done else LINGER_APART_S
        if member.level and waited_s >= least_s:
            break
        await asyncio.sleep(BEAT_S)
        waited_s += BEAT_S
