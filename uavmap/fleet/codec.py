"""The messages between members of a fleet, as bytes: positions, known facts, and facts.

A message is one datagram. A fact is the rectangle of its cells, the cells in it, their decisions,
and their shares of classes, in tenths. A 0 before it marks a fact on the doubt of cells. A batch of
facts is deflated. Times are whole milliseconds of mission time, places half metres, and those of
work shares 4 m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final, Literal, NamedTuple, get_args

from missions.classes import MAX_CLASS_NUMBER, ClassShare
from missions.fleet_events import Fact, Part
from missions.units import Cell, GridPoint, PadHeight
from uavmap.fleet.bits import MAX_CELLS, BytesError, Reader, Writer, deflated, inflated
from uavmap.fleet.knowledge import MAX_RUNS, Holding

Does = Literal["stands", "flies", "returns", "pilot", "guarded", "ended", "down"]
DOES: Final[tuple[Does, ...]] = get_args(Does)
STEP_M: Final = 0.5
PART_M: Final = 4.0
"""Resolution of observation points: a step of up to 250 m is one byte."""
MAX_BYTES: Final = 1 << 20
_MOST: Final = 10_000
_CLASSES: Final = 3
"""Kind of a fact with classes; 0 to 2: decided, by a search, seen in passing."""
_TENTHS: Final = 10
_DOUBT: Final = 0
"""Stands before a fact on unsure cells; the head of any other is 4 or more."""


@dataclass(frozen=True, slots=True)
class Presence:
    """The position of a member's vehicle, and its next actions."""

    does: Does
    position: GridPoint
    height_m: float
    charge: float
    """Charge of its battery, 0 to 1."""
    layer_m: float
    lanes: tuple[int, ...] = ()
    path: tuple[GridPoint, ...] = ()


@dataclass(frozen=True, slots=True)
class Batch:
    """Facts of one member, numbered from `first` on."""

    origin: int
    first: int
    facts: tuple[Fact, ...]


Order = Literal["recall", "pause", "continue"]
ORDERS: Final[tuple[Order, ...]] = get_args(Order)


class AirRequest(NamedTuple):
    """The air above and below a place that a member requests; its requests are numbered."""

    number: int
    place: GridPoint
    low_m: float
    high_m: float
    until_s: float


class OperatorOrder(NamedTuple):
    """An operator's order; the one with the highest stamp holds, and every member repeats it."""

    stamp: int
    vehicle: int
    """Number of the vehicle; 0: all of them."""
    order: Order


@dataclass(frozen=True, slots=True)
class Message:
    """One datagram: the message of a member."""

    t_s: float
    """Mission time of the sender."""
    presence: Presence | None = None
    """Position of the vehicle; None for a member without one."""
    have: dict[int, Holding] = field(default_factory=dict)
    """Facts of each member that the sender knows."""
    batches: tuple[Batch, ...] = ()
    words: tuple[OperatorOrder, ...] = ()
    begun: bool = False
    """True if the sender's clock is that of the fleet, and moves no more."""
    ask: AirRequest | None = None
    promised: dict[int, int] = field(default_factory=dict)
    """Requests to which the sender agrees, by vehicle: the number of the request."""
    parts: tuple[Part, ...] = ()
    """Work shares that the sender has assigned."""
    pad: PadHeight | None = None
    """Height that a vehicle's receiver reported on its pad, by the half metre."""


def encode(message: Message) -> bytes:
    """Return the bytes of a message. Raises ValueError for an impossible value: a negative count.

    >>> here = Presence("flies", GridPoint(3.0, -4.5), 12.0, 0.8, 12.0)
    >>> message = Message(12.5, here, {1: Holding(7)})
    >>> len(encode(message)), decode(encode(message)) == message
    (16, True)
    """
    out = Writer()
    out.integer(_ms(message.t_s))
    does = 0 if message.presence is None else 1 + DOES.index(message.presence.does)
    flags = 8 * (message.pad is not None) + 4 * bool(message.parts)
    flags += 2 * (message.ask is not None) + message.begun
    out.count(16 * does + flags)
    if message.pad is not None:
        out.integer(round(message.pad.amsl_m / STEP_M))
        out.count(math.ceil(message.pad.sigma_m / STEP_M))
    if message.presence is not None:
        _put_presence(out, message.presence)
    out.count(len(message.have))
    for origin, holding in sorted(message.have.items()):
        out.count(origin)
        _put_holding(out, holding)
    out.count(len(message.words))
    for word in message.words:
        out.count(word.stamp)
        out.count(word.vehicle)
        out.count(ORDERS.index(word.order))
    if message.ask is not None:
        _put_ask(out, message.ask)
    out.count(len(message.promised))
    for vehicle, number in sorted(message.promised.items()):
        out.count(vehicle)
        out.count(number)
    if message.parts:
        _put_parts(out, message.parts)
    for batch in message.batches:
        out.count(batch.origin)
        out.count(batch.first)
        out.raw(deflated(facts_to_bytes(batch.facts)))
    return out.data


def decode(data: bytes) -> Message:
    """Return the message of bytes: the inverse of `encode`. Raises `BytesError` for other bytes."""
    inp = Reader(data)
    t_s = inp.integer() / 1000
    does, flags = divmod(inp.count(), 16)
    if does > len(DOES):
        raise BytesError("no such activity")
    pad = PadHeight(inp.integer() * STEP_M, inp.count() * STEP_M) if flags & 8 else None
    presence = _presence(inp, DOES[does - 1]) if does else None
    have = {inp.count(): _holding(inp) for _ in range(_few(inp.count()))}
    words = tuple(_operator_order(inp) for _ in range(_few(inp.count())))
    ask = _ask(inp) if flags & 2 else None
    promised = {inp.count(): inp.count() for _ in range(_few(inp.count()))}
    parts = _parts(inp) if flags & 4 else ()
    batches = []
    while not inp.at_end:
        origin, first = inp.count(), inp.count()
        batches.append(Batch(origin, first, bytes_to_facts(inflated(inp.raw(), MAX_BYTES))))
    return Message(
        t_s, presence, have, tuple(batches), words, bool(flags & 1), ask, promised, parts, pad
    )


def facts_to_bytes(facts: Sequence[Fact]) -> bytes:
    """Return facts as bytes, each by its difference from the one before."""
    out = Writer()
    t_ms, anchor = 0, Cell(0, 0)
    for fact in facts:
        now_ms = _ms(fact.t_s)
        out.integer(now_ms - t_ms)
        cells = [cell for cell, _ in fact.votes]
        west, south = min(c.east for c in cells), min(c.north for c in cells)
        columns = max(c.east for c in cells) - west + 1
        rows = max(c.north for c in cells) - south + 1
        kind = _CLASSES if fact.classes else 2 * fact.seen + fact.overview
        if fact.doubt:
            out.count(_DOUBT)
        out.count(4 * columns + kind)
        out.count(rows)
        out.integer(west - anchor.east)
        out.integer(south - anchor.north)
        verdicts = dict(fact.votes)
        inside = [Cell(west + i, south + j) for j in range(rows) for i in range(columns)]
        out.flags([cell in verdicts for cell in inside])
        if not fact.seen:
            out.flags([verdicts[cell] for cell in inside if cell in verdicts])
        if fact.classes:
            _put_classes(out, fact)
        t_ms, anchor = now_ms, Cell(west, south)
    return out.data


def bytes_to_facts(data: bytes) -> tuple[Fact, ...]:
    """Return the facts of bytes: the inverse of `facts_to_bytes`. Raises `BytesError`."""
    inp = Reader(data)
    t_ms, west, south = 0, 0, 0
    facts = []
    while not inp.at_end:
        t_ms += inp.integer()
        head = inp.count()
        doubt = head == _DOUBT
        columns, kind = divmod(inp.count() if doubt else head, 4)
        rows = inp.count()
        if not 0 < columns * rows <= MAX_CELLS:
            raise BytesError("no fact is of so many cells")
        west += inp.integer()
        south += inp.integer()
        shown = inp.flags(columns * rows)
        cells = [
            Cell(west + k % columns, south + k // columns)
            for k, reported in enumerate(shown)
            if reported
        ]
        if t_ms < 0 or not cells:
            raise BytesError("a fact of nothing")
        seen, overview = kind == 2, kind == 1
        verdicts = [False] * len(cells) if seen else inp.flags(len(cells))
        votes = tuple(sorted(zip(cells, verdicts, strict=True)))
        classes = _classes(inp, sorted(cells)) if kind == _CLASSES else ()
        if doubt and (seen or overview):
            raise BytesError("such a fact has no doubts")
        facts.append(Fact(t_ms / 1000, votes, overview, seen, classes, doubt))
    return tuple(facts)


def _put_classes(out: Writer, fact: Fact) -> None:
    """Write of each class its number, the cells with a share of it, and the shares; then 0."""
    cells = sorted(cell for cell, _ in fact.votes)
    for number, some in groupby(fact.classes, key=lambda one: one.number):
        tenths = {one.cell: round(_TENTHS * one.share) for one in some}
        out.count(number)
        out.flags([cell in tenths for cell in cells])
        for cell in sorted(tenths):
            out.count(tenths[cell])
    out.count(0)


def _classes(inp: Reader, cells: Sequence[Cell]) -> tuple[ClassShare, ...]:
    found: list[ClassShare] = []
    while number := inp.count():
        there = [cell for cell, is_of in zip(cells, inp.flags(len(cells)), strict=True) if is_of]
        found += [ClassShare(cell, number, inp.count() / _TENTHS) for cell in there]
        if number > MAX_CLASS_NUMBER or not there or any(one.share > 1.0 for one in found):
            raise BytesError("no class has such shares")
    if not found:
        raise BytesError("classes of nothing")
    return tuple(found)


def _put_presence(out: Writer, presence: Presence) -> None:
    at = _put_places(out, (presence.position,), STEP_M)
    out.integer(round(presence.height_m / STEP_M))
    out.count(round(100 * min(max(presence.charge, 0.0), 1.0)))
    out.count(max(round(presence.layer_m / STEP_M), 0))
    out.count(len(presence.lanes))
    for lane in presence.lanes:
        out.count(lane)
    out.count(len(presence.path))
    _put_places(out, presence.path, STEP_M, at)


def _presence(inp: Reader, does: Does) -> Presence:
    (position,), at = _places(inp, 1, STEP_M)
    height_m, charge, layer_m = inp.integer() * STEP_M, inp.count() / 100, inp.count() * STEP_M
    if charge > 1.0:
        raise BytesError("a charge is above 1")
    lanes = tuple(inp.count() for _ in range(_few(inp.count())))
    path, _ = _places(inp, inp.count(), STEP_M, at)
    return Presence(does, position, height_m, charge, layer_m, lanes, path)


def _put_holding(out: Writer, holding: Holding) -> None:
    out.count((MAX_RUNS + 1) * holding.upto + len(holding.beyond))
    end = holding.upto
    for first, after in holding.beyond:
        out.count(first - end)
        out.count(after - first)
        end = after


def _holding(inp: Reader) -> Holding:
    upto, runs = divmod(inp.count(), MAX_RUNS + 1)
    beyond, end = [], upto
    for _ in range(runs):
        gap, length = inp.count(), inp.count()
        if gap == 0 or length == 0:
            raise BytesError("runs that are none")
        beyond.append((end + gap, end + gap + length))
        end += gap + length
    return Holding(upto, tuple(beyond))


def _put_ask(out: Writer, ask: AirRequest) -> None:
    out.count(ask.number)
    _put_places(out, (ask.place,), STEP_M)
    out.integer(math.floor(ask.low_m / STEP_M))
    out.integer(math.ceil(ask.high_m / STEP_M))
    out.count(math.ceil(ask.until_s))


def _ask(inp: Reader) -> AirRequest:
    number = inp.count()
    (place,), _ = _places(inp, 1, STEP_M)
    low_m, high_m = inp.integer() * STEP_M, inp.integer() * STEP_M
    return AirRequest(number, place, low_m, high_m, float(inp.count()))


def _put_parts(out: Writer, parts: Sequence[Part]) -> None:
    out.count(len(parts))
    at = (0, 0)
    for part in parts:
        out.count(part.vehicle)
        out.count(len(part.places))
        at = _put_places(out, part.places, PART_M, at)


def _parts(inp: Reader) -> tuple[Part, ...]:
    parts, at = [], (0, 0)
    for _ in range(_few(inp.count())):
        vehicle = inp.count()
        places, at = _places(inp, inp.count(), PART_M, at)
        parts.append(Part(vehicle, places))
    if not parts:
        raise BytesError("a share-out without vehicles")
    return tuple(parts)


def _operator_order(inp: Reader) -> OperatorOrder:
    stamp, vehicle, order = inp.count(), inp.count(), inp.count()
    if order >= len(ORDERS):
        raise BytesError("no such order")
    return OperatorOrder(stamp, vehicle, ORDERS[order])


def _few(number: int) -> int:
    if number > _MOST:
        raise BytesError("a number is too large")
    return number


def _ms(t_s: float) -> int:
    return round(t_s * 1000)


def _put_places(
    out: Writer, places: Sequence[GridPoint], step_m: float, at: tuple[int, int] = (0, 0)
) -> tuple[int, int]:
    """Write places in steps from the one before, `at` first; return the last."""
    for place in places:
        east, north = round(place.east_m / step_m), round(place.north_m / step_m)
        out.integer(east - at[0])
        out.integer(north - at[1])
        at = east, north
    return at


def _places(
    inp: Reader, number: int, step_m: float, at: tuple[int, int] = (0, 0)
) -> tuple[tuple[GridPoint, ...], tuple[int, int]]:
    places = []
    for _ in range(_few(number)):
        at = at[0] + inp.integer(), at[1] + inp.integer()
        places.append(GridPoint(at[0] * step_m, at[1] * step_m))
    return tuple(places), at
