"""The messages between the mission and the aircraft: orders one way, events the other.

    mission  -> Begin, Fly, GiveOrder, ... -> aircraft
    mission  <- Ready, EventReport, Picture, Ended, ... <- aircraft

A message is a value. On the wire it is eight bytes with the lengths of its parts, then its JSON,
then the bytes of a picture. Simulated flights pass the same bytes inside one process.
"""

from __future__ import annotations

import dataclasses
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from missions.errors import LinkError
from missions.events import AnyEvent
from missions.orders import Order
from missions.units import Cell, LatLon, PadHeight, Pose

_LENGTHS: Final = struct.Struct(">II")
MAX_TEXT_BYTES: Final = 32 << 20
"""Maximum length of the JSON of a message, bytes: a verdict on 400,000 cells."""
MAX_PICTURE_BYTES: Final = 96 << 20
"""Maximum length of a picture, bytes: the pixels of an 8K frame; files are smaller."""
FIRST_BYTES: Final = 1024
"""Maximum length of a connection's data before its token is known, bytes."""


# --- from the mission ---------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class Attach:
    """The first message of a connection to a process of aircraft: the token of its file."""

    version: int
    token: str
    kind: Literal["attach"] = "attach"


@dataclass(frozen=True, slots=True)
class EarlierFlight:
    """The journal's knowledge of a vehicle when a flight is resumed."""

    flew: bool = False
    """True if it was in the air by our order."""
    returned: bool = False
    """True if it may have been landing or returning by our order."""


@dataclass(frozen=True, slots=True)
class PreflightOptions:
    """The operator's options for the examination before a flight."""

    lines: tuple[str, ...]
    """Lines on the planned flight."""
    yes: bool
    dry_run: bool


@dataclass(frozen=True, slots=True)
class Begin:
    """Connect to the vehicles, and prepare them."""

    t_s: float
    """Mission time at which the clock of the loop was zero, until `Fly` sets another, s."""
    before: dict[int, EarlierFlight]
    preflight: PreflightOptions | None
    """None: a resumed flight, without questions."""
    keep_fence: bool
    waits_on_ground: bool
    """True if a crew is beside silent vehicles on the ground."""
    kind: Literal["begin"] = "begin"


@dataclass(frozen=True, slots=True)
class Fly:
    """Report, and carry out orders; the loop's clock was zero at mission time `start_s`."""

    start_s: float
    kind: Literal["fly"] = "fly"


@dataclass(frozen=True, slots=True)
class GiveOrder:
    """Carry out an order instead of the present one."""

    vehicle: int
    order: Order
    kind: Literal["give"] = "give"


@dataclass(frozen=True, slots=True)
class LandHere:
    """Have the guardian land a vehicle where it is."""

    vehicle: int
    reason: str
    kind: Literal["land_here"] = "land_here"


@dataclass(frozen=True, slots=True)
class PictureJudged:
    """A picture was judged, and its consequences are ordered."""

    serial: int
    seen: bool
    """True if it shows something of the ground; it is lost otherwise."""
    kind: Literal["judged"] = "judged"


@dataclass(frozen=True, slots=True)
class SwapDone:
    """The battery of a vehicle is swapped, and it may take off."""

    vehicle: int
    kind: Literal["swapped"] = "swapped"


@dataclass(frozen=True, slots=True)
class Answered:
    """The operator has answered the question; None: there is no operator."""

    yes: bool | None
    kind: Literal["answered"] = "answered"


@dataclass(frozen=True, slots=True)
class Finish:
    """The mission is over: return every vehicle in the air, restore settings, end."""

    reason: str
    kind: Literal["finish"] = "finish"


@dataclass(frozen=True, slots=True)
class Leave:
    """The operator does not wait: command each autopilot to return, see that it does, end."""

    reason: str
    kind: Literal["leave"] = "leave"


@dataclass(frozen=True, slots=True)
class Beat:
    """The sender is alive."""

    boot_s: float | None = None
    """Time since the first vehicle was switched on, s, sent by the aircraft."""
    kept: int = 0
    """Number of the last `EventReport` that is in the journal, sent by the mission."""
    fates: dict[int, str] = field(default_factory=dict)
    """Fates as in `Ended`, if the flight ended now, sent by the aircraft."""
    kind: Literal["beat"] = "beat"


# --- from the aircraft --------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class Attached:
    """The answer to `Attach`.

    It is a refusal while another mission has the aircraft, to another version, and while they
    return.
    """

    state: Literal["new", "flying", "returning", "refused"]
    reason: str = ""
    fates: dict[int, str] = field(default_factory=dict)
    """Fates as in `Ended`, while they return."""
    kind: Literal["attached"] = "attached"


@dataclass(frozen=True, slots=True)
class Ready:
    """All vehicles have answered and are prepared."""

    boot_s: float | None
    start_s: float | None = None
    """Mission time at which the clock of the loop was zero, if the aircraft know it, s."""
    standing: dict[int, LatLon] = field(default_factory=dict)
    """Positions of vehicles whose motors are off."""
    pads: dict[int, PadHeight] = field(default_factory=dict)
    """Heights of their pads, by their receivers."""
    kind: Literal["ready"] = "ready"


@dataclass(frozen=True, slots=True)
class EventReport:
    """A vehicle reports."""

    event: AnyEvent
    serial: int = 0
    """Its number, from 1 for each process of the aircraft."""
    kind: Literal["happened"] = "happened"


@dataclass(frozen=True, slots=True)
class Telemetry:
    """A vehicle's report beside events, for onlookers; None for unknown values.

    The live page gets each field by its name.
    """

    vehicle: int
    mode: str
    """Mode by the autopilot's name."""
    satellites: int | None
    hdop: float | None
    volts: float | None
    loss_percent: int | None
    """Share of the autopilot's frames that were lost, percent."""
    late_s: float
    """Age of its latest position, s."""
    kind: Literal["telemetry"] = "telemetry"


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture to judge; the sender waits for `PictureJudged`."""

    serial: int
    vehicle: int
    t_s: float
    """Mission time of the exposure, s."""
    pose: Pose
    vantage: Cell | None
    anywhere: bool
    name: str
    shape: tuple[int, int, int] | None
    """Shape of pixels, blue-green-red; None if `data` is a file (JPEG, PNG)."""
    data: bytes = b""
    kind: Literal["picture"] = "picture"

    @property
    def content(self) -> bytes | NDArray[np.uint8]:
        """Return the file, or the pixels."""
        if self.shape is None:
            return self.data
        return np.frombuffer(self.data, np.uint8).reshape(self.shape)


@dataclass(frozen=True, slots=True)
class SwapRequested:
    """A vehicle has landed and waits for a fresh battery."""

    vehicle: int
    kind: Literal["battery_wanted"] = "battery_wanted"


@dataclass(frozen=True, slots=True)
class SwapCancelled:
    """The vehicle does not wait any longer."""

    vehicle: int
    kind: Literal["battery_unwanted"] = "battery_unwanted"


@dataclass(frozen=True, slots=True)
class Question:
    """A question to the operator."""

    text: str
    kind: Literal["question"] = "question"


@dataclass(frozen=True, slots=True)
class Line:
    """A line for the operator."""

    text: str
    kind: Literal["line"] = "line"


@dataclass(frozen=True, slots=True)
class Recall:
    """This process was asked to end: the mission must recall all vehicles."""

    kind: Literal["recall"] = "recall"


@dataclass(frozen=True, slots=True)
class Ended:
    """The last message: the fate of the aircraft."""

    fates: dict[int, str]
    """Position of each received vehicle, as text; empty for one at home."""
    error: str | None = None
    """Name of the error of `missions.errors` that ended it; "defect" for one of the program."""
    text: str = ""
    could_fly: bool = False
    kind: Literal["ended"] = "ended"


Message = (
    Attach | Begin | Fly | GiveOrder | LandHere | PictureJudged | SwapDone | Answered | Finish
    | Leave | Beat | Attached | Ready | EventReport | Picture | SwapRequested | SwapCancelled
    | Question | Line | Recall | Ended | Telemetry
)  # fmt: skip


def version_of(messages: Iterable[type]) -> int:
    """Return a number for the fields of messages and their types: a change gives another one."""
    fields = (
        f"{cls.__name__}.{each.name}: {each.type}"
        for cls in messages if dataclasses.is_dataclass(cls) for each in dataclasses.fields(cls)
    )  # fmt: skip
    return zlib.crc32("\n".join(fields).encode())


VERSION: Final = version_of([each for each in vars().values() if isinstance(each, type)])
"""Number of this set of messages; two processes with different numbers do not connect."""
_ADAPTER: Final[TypeAdapter[Message]] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def encode(message: Message) -> bytes:
    """Return the bytes of a message."""
    data = b""
    if isinstance(message, Picture):
        data, message = message.data, dataclasses.replace(message, data=b"")
    text = _ADAPTER.dump_json(message)
    return _LENGTHS.pack(len(text), len(data)) + text + data


class Decoder:
    """Decodes messages from bytes that come in pieces."""

    def __init__(self, *, known: bool = True) -> None:
        self.known = known
        """True if the sender is known; another can only send an `Attach`."""
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[Message]:
        """Yield the messages that are whole by now. Raises `LinkError` for invalid ones."""
        self._buffer += data
        while len(self._buffer) >= _LENGTHS.size:
            text_size, data_size = _LENGTHS.unpack_from(self._buffer)
            most = (MAX_TEXT_BYTES, MAX_PICTURE_BYTES) if self.known else (FIRST_BYTES, 0)
            if text_size > most[0] or data_size > most[1]:
                raise LinkError(
                    "the aircraft process and the mission do not understand each other: a message "
                    f"of {text_size + data_size} bytes"
                )
            begin = _LENGTHS.size
            end = begin + text_size + data_size
            if len(self._buffer) < end:
                return
            text = bytes(self._buffer[begin : begin + text_size])
            content = bytes(self._buffer[begin + text_size : end])
            del self._buffer[:end]
            yield _decoded(text, content)


def as_bytes(receive: Callable[[Message], None]) -> Callable[[Message], None]:
    """Return a function that sends messages to `receive` in this process, as the bytes of two."""
    decoder = Decoder()

    def send(message: Message) -> None:
        for copy in decoder.feed(encode(message)):
            receive(copy)

    return send


def _decoded(text: bytes, data: bytes) -> Message:
    try:
        message = _ADAPTER.validate_json(text)
    except ValidationError as error:
        raise LinkError(
            f"no message between mission and aircraft: {error.errors()[0]['msg']}"
        ) from None
    if not isinstance(message, Picture):
        return message
    shape = message.shape
    if shape is not None and (min(shape) < 0 or math.prod(shape) != len(data)):
        raise LinkError(f"no message between mission and aircraft: {len(data)} bytes for {shape}")
    return dataclasses.replace(message, data=data)
