"""A simulated air between members in one process: range, loss, delay, partitions, bandwidth."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final

from missions.fleet_events import Partition
from missions.units import GridPoint

OVERHEAD_BYTES: Final = 28
"""Bytes of IPv4 and UDP: of a datagram on the air besides itself."""


@dataclass(frozen=True, slots=True)
class LinkModel:
    """The fate of a datagram between two members."""

    range_m: float = math.inf
    loss: float = 0.0
    delay_s: float = 0.02
    jitter_s: float = 0.0
    doubled: float = 0.0
    bytes_per_s: float = math.inf
    """Maximum throughput of one sender, bytes/s; more waits, and is lost beyond a second of it."""
    partitions: Sequence[Partition] = ()


MEETING_M: Final = 20.0
"""Distance within which two members meet, m."""


def link_model(text: str) -> LinkModel:
    """Return a model by its name and values of the command line. Raises ValueError with the remedy.

    >>> link_model("range:200,loss:0.1").range_m
    200.0
    >>> link_model("meeting").range_m
    20.0
    """
    words = parse_link_spec(
        text, ("free", "meeting"), "METRES", ("loss", "delay", "jitter", "rate")
    )
    values = words.numbers
    far_m = MEETING_M if words.kind == "meeting" else values.get(RANGE, math.inf)
    none = LinkModel()
    return LinkModel(
        range_m=far_m,
        loss=values.get("loss", none.loss),
        delay_s=values.get("delay", none.delay_s),
        jitter_s=values.get("jitter", none.jitter_s),
        bytes_per_s=values.get("rate", none.bytes_per_s),
    )


@dataclass(slots=True)
class Air:
    """The air that members share, on the event loop's time, the same for the same seed."""

    model: LinkModel
    seed: int = 0
    sent_bytes: dict[int, int] = field(default_factory=dict)
    """Bytes on the air, by sender, with `OVERHEAD_BYTES` a datagram."""
    _places: dict[int, Callable[[], tuple[GridPoint, float]]] = field(default_factory=dict)
    _receivers: dict[int, Callable[[bytes], None]] = field(default_factory=dict)
    _free_s: dict[int, float] = field(default_factory=dict)
    _random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def radio(self, member: int, place: Callable[[], tuple[GridPoint, float]]) -> AirRadio:
        """Return the radio of a member at `place`: over ground, and its height."""
        self._places[member] = place
        return AirRadio(self, member)

    def silence(self, member: int) -> None:
        """Note the end of a member's program: it neither receives nor is received."""
        self._receivers.pop(member, None)

    def are_in_range(self, one: int, other: int, t_s: float) -> bool:
        """Return whether two are in range of each other, and no partition separates them."""
        if any(partition.parts(one, other, t_s) for partition in self.model.partitions):
            return False
        if math.isinf(self.model.range_m):
            return True
        (here, low_m), (there, high_m) = self._places[one](), self._places[other]()
        return math.hypot(here.distance_to(there), high_m - low_m) <= self.model.range_m

    def carry(self, sender: int, datagram: bytes) -> None:
        """Deliver a datagram to members in range, or not."""
        loop = asyncio.get_running_loop()
        now_s, model = loop.time(), self.model
        size = len(datagram) + OVERHEAD_BYTES
        begin_s = max(self._free_s.get(sender, 0.0), now_s)
        if begin_s - now_s > 1.0:
            return
        end_s = begin_s + size / model.bytes_per_s
        self._free_s[sender] = end_s
        self.sent_bytes[sender] = self.sent_bytes.get(sender, 0) + size
        for other in sorted(self._receivers):
            if other == sender:
                continue
            lost, twice = self._random.random() < model.loss, self._random.random() < model.doubled
            late_s = [self._random.random() * model.jitter_s for _ in range(2)]
            if lost or not self.are_in_range(sender, other, now_s):
                continue
            for copy in range(2 if twice else 1):
                loop.call_at(end_s + model.delay_s + late_s[copy], self._deliver, other, datagram)

    def _deliver(self, member: int, datagram: bytes) -> None:
        received = self._receivers.get(member)
        if received is not None:
            received(datagram)

    def add_member(self, member: int, received: Callable[[bytes], None]) -> None:
        """Note that a member listens from now on."""
        self._receivers[member] = received


@dataclass(frozen=True, slots=True)
class AirRadio:
    """One member's radio in a simulated air."""

    overhead_bytes: ClassVar[int] = OVERHEAD_BYTES
    air: Air
    member: int

    def send(self, datagram: bytes) -> None:
        """Send to all in range."""
        self.air.carry(self.member, datagram)

    def listen(self, received: Callable[[bytes], None]) -> None:
        """Pass received datagrams on."""
        self.air.add_member(self.member, received)


# --- the words of `--comms`, in flight and on the grid ------------------------------------------
RANGE: Final = "range"
_MEANT: Final = {
    "loss": "the share that is lost, such as loss:0.1",
    "delay": "a time, such as delay:0.5",
    "jitter": "a time, such as jitter:0.1",
    "rate": "an amount of data in a unit of time, such as rate:300",
}


@dataclass(frozen=True, slots=True)
class LinkSpec:
    """A parsed text: a kind, numbers by key, and the texts of other keys as often as they came."""

    kind: str
    numbers: Mapping[str, float]
    others: tuple[tuple[str, str], ...] = ()


def parse_link_spec(
    text: str, kinds: Sequence[str], unit: str, keys: Sequence[str], others: Sequence[str] = ()
) -> LinkSpec:
    """Parse `KIND[,KEY:VALUE...]`, where the kind is a name or `range:NUMBER`.

    Args:
        text: As on the command line.
        kinds: Names without a number.
        unit: Unit of the range, for messages.
        keys: Those with a number, each at most once: not negative, a loss at most 1, a rate above
            0. A range and a rate may be infinite.
        others: Those whose values are any text.

    Raises ValueError for anything else, with what to write.

    >>> parse_link_spec("range:200,loss:0.1", ["free"], "METRES", ["loss"]).numbers
    {'range': 200.0, 'loss': 0.1}
    >>> parse_link_spec("fre", ["free"], "METRES", ["loss"])
    Traceback (most recent call last):
    ValueError: 'fre' is none of free, range:METRES
    """
    first, *rest = text.split(",")
    kind, _, value = first.partition(":")
    numbers: dict[str, float] = {}
    kept = []
    if kind == RANGE:
        numbers[RANGE] = _number(RANGE, value, f"a distance in {unit.lower()}")
    elif first not in kinds:
        raise ValueError(f"{first!r} is none of {', '.join(kinds)}, {RANGE}:{unit}")
    for key, _, value in (part.partition(":") for part in rest):
        if key in others:
            kept.append((key, value))
        elif key not in keys:
            known = ", ".join([*keys, *others])
            raise ValueError(f"{key!r} is not known; after a comma stands one of {known}")
        elif key in numbers:
            raise ValueError(f"{key} stands there twice; leave one out")
        else:
            numbers[key] = _number(key, value, _MEANT[key])
    return LinkSpec(kind, numbers, tuple(kept))


def _number(key: str, text: str, meant: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    unbounded = key in (RANGE, "rate")
    if math.isnan(value) or (math.isinf(value) and not unbounded):
        raise ValueError(f"{key}:{text} is not a number; it is {meant}")
    if value < 0.0 or (key == "rate" and value == 0.0):
        least = "above 0" if key == "rate" else "0 or more"
        raise ValueError(f"{key}:{text} has to be {least}; it is {meant}")
    if key == "loss" and value > 1.0:
        raise ValueError(f"{key}:{text} is above 1; it is {meant}")
    return value
