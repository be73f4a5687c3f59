"""Everything that happens, as values: the journal is a list of these.

Positions are in the grid's fixed frame, rounded to a centimetre, times in mission seconds to a
millisecond: the journal has exactly what the service acted on, in the order of the fields.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, fields
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field, TypeAdapter
from pydantic_core import PydanticSerializationError

from missions.classes import ClassShare
from missions.errors import EventError
from missions.fleet_events import Allotted, Apart, Asked, Heard, Leased, OfVehicle, Shared
from missions.traffic import Track
from missions.units import Cell, GridPoint


class Vote(NamedTuple):
    """What one frame says of one cell; `share` is the part of it that looks like ROI."""

    cell: Cell
    positive: bool
    share: float


@dataclass(frozen=True, slots=True)
class Connected(OfVehicle):
    """A vehicle answered. Posted at the start, after a resume, and when a lost link is back."""

    home: GridPoint
    position: GridPoint
    height_m: float
    airborne: bool
    ours: bool
    """Whether its mode follows our commands."""
    remaining_wh: float
    kind: Literal["connected"] = "connected"
    home_amsl_m: float | None = None
    """Height of home above the sea, None where the vehicle has not said."""
    mode: Literal["follow", "rtl", "land", "other"] | None = None
    """What its autopilot does in the air: follow us, return, land, or something else."""


@dataclass(frozen=True, slots=True)
class LiftedOff(OfVehicle):
    """The vehicle left the ground with its motors on, ordered or not."""

    kind: Literal["lifted_off"] = "lifted_off"


@dataclass(frozen=True, slots=True)
class Airborne(OfVehicle):
    """A take-off reached its height."""

    kind: Literal["airborne"] = "airborne"
    home: GridPoint | None = None
    """Where home is now: arming moves it to where the vehicle stands."""
    home_amsl_m: float | None = None


@dataclass(frozen=True, slots=True)
class Tracked(OfVehicle):
    """Where a vehicle is and what is left in its battery, about once a second."""

    position: GridPoint
    height_m: float
    remaining_wh: float
    kind: Literal["tracked"] = "tracked"
    wind_m_s: float | None = None
    """Wind measured in flight, None where nothing can be said of it."""


@dataclass(frozen=True, slots=True)
class Arrived(OfVehicle):
    """The leg that was ordered is flown."""

    position: GridPoint
    kind: Literal["arrived"] = "arrived"


@dataclass(frozen=True, slots=True)
class FrameSeen(OfVehicle):
    """A picture was judged: taken over `vantage`, or (None) from wherever the vehicle was."""

    vantage: Cell | None
    votes: tuple[Vote, ...]
    kind: Literal["frame_seen"] = "frame_seen"
    overview: Literal[True] | None = None
    """Taken from the height of a search, where a cell has few pixels."""
    unsure: tuple[Cell, ...] | None = None
    """Cells that look like nothing that the detector knows; their votes say no region."""
    classes: tuple[ClassShare, ...] | None = None
    """Shares above 0 of its cells by class, of a detector that tells several apart."""


@dataclass(frozen=True, slots=True)
class Weighed(OfVehicle):
    """What the votes of the picture just judged weigh, 0 to 1 each, in their order: of a recorded
    one, whose cells are decided by evidence (`missions.mapping.evidence`)."""

    weights: tuple[float, ...]
    kind: Literal["weighed"] = "weighed"


@dataclass(frozen=True, slots=True)
class FrameLost(OfVehicle):
    """A picture that was asked for is missing or cannot be read."""

    reason: str
    kind: Literal["frame_lost"] = "frame_lost"


@dataclass(frozen=True, slots=True)
class LookEnded(OfVehicle):
    """All the pictures that an order allowed were taken; some cells may lack votes."""

    kind: Literal["look_ended"] = "look_ended"


@dataclass(frozen=True, slots=True)
class Landed(OfVehicle):
    """A vehicle stands on the ground, motors off."""

    remaining_wh: float
    kind: Literal["landed"] = "landed"
    position: GridPoint | None = None
    """Where it stands; None in old journals, which do not say."""


@dataclass(frozen=True, slots=True)
class Crashed(OfVehicle):
    """A vehicle is down where it was not told to land: somebody has to fetch it."""

    position: GridPoint
    reason: str
    kind: Literal["crashed"] = "crashed"


@dataclass(frozen=True, slots=True)
class Guarded(OfVehicle):
    """The guardian of a vehicle has it return or land by its autopilot, and keeps it until down."""

    action: Literal["rtl", "land"]
    reason: str
    kind: Literal["guarded"] = "guarded"


@dataclass(frozen=True, slots=True)
class Navigated(OfVehicle):
    """What a vehicle navigates by, when that changes, and from time to time without satellites.
    Nothing acts on it: positions of other events are corrected already."""

    gnss: Literal["good", "lost", "wrong"]
    sigma_m: float | None = None
    """How well its place is known by its own pictures, one standard deviation; None: not so."""
    off_m: GridPoint | None = None
    """By how much the place that its autopilot tells is off, along the grid's axes."""
    kind: Literal["navigated"] = "navigated"


@dataclass(frozen=True, slots=True)
class BatterySwapped(OfVehicle):
    """A vehicle on the ground has a fresh battery."""

    remaining_wh: float
    kind: Literal["battery_swapped"] = "battery_swapped"


UNTOLD: Final = "a failsafe; the autopilot has not said which"
"""The cause of an `Overridden` whose vehicle says that a failsafe flies, and no more yet."""


@dataclass(frozen=True, slots=True)
class Overridden(OfVehicle):
    """The mode changed without us: a pilot or a failsafe flies the vehicle now."""

    mode: str
    kind: Literal["overridden"] = "overridden"
    cause: str | None = None
    """Why, if the vehicle has said it: "battery failsafe: Battery 1 is low 9.90V"."""


@dataclass(frozen=True, slots=True)
class Released(OfVehicle):
    """The vehicle was given back: it is in the mode in which it follows us."""

    position: GridPoint
    height_m: float
    kind: Literal["released"] = "released"


@dataclass(frozen=True, slots=True)
class LinkLost(OfVehicle):
    """No heartbeat for too long."""

    kind: Literal["link_lost"] = "link_lost"


@dataclass(frozen=True, slots=True)
class GivenUp(OfVehicle):
    """A silent vehicle is not waited for any longer; it is taken up again when it speaks."""

    reason: str
    kind: Literal["given_up"] = "given_up"


@dataclass(frozen=True, slots=True)
class OrderFailed(OfVehicle):
    """An order failed; the vehicle comes home and takes no further part. One that is only `behind`
    its path may go on from where it is."""

    order: str
    reason: str
    kind: Literal["order_failed"] = "order_failed"
    behind: bool = False


@dataclass(frozen=True, slots=True)
class Recalled:
    """The operator calls everybody home."""

    t_s: float
    kind: Literal["recalled"] = "recalled"
    stamp: int | None = None
    """Number of an operator's word to a fleet; None of an order given here."""


@dataclass(frozen=True, slots=True)
class Paused:
    """The operator has everybody hold where they are; who is on its way home goes on."""

    t_s: float
    kind: Literal["paused"] = "paused"
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class Continued:
    """The operator lets a mission go on that was paused."""

    t_s: float
    kind: Literal["continued"] = "continued"
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class VehicleRecalled(OfVehicle):
    """The operator calls one vehicle home; it takes no further part until a resume."""

    kind: Literal["vehicle_recalled"] = "vehicle_recalled"
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class CellSkipped(OfVehicle):
    """The operator has nobody look from a cell: the one that a vehicle was at, or on its way to."""

    cell: Cell
    kind: Literal["cell_skipped"] = "cell_skipped"


@dataclass(frozen=True, slots=True)
class Told(OfVehicle):
    """What a vehicle said in words (STATUSTEXT). It changes nothing that anybody acts on."""

    severity: int
    """MAV_SEVERITY: 0 is an emergency, 7 for debugging."""
    text: str
    kind: Literal["told"] = "told"
    times: int = 1
    """How often it was said in the same words since it was last noted."""
    cause: str | None = None
    """Of a failsafe that has taken the vehicle already: why."""


@dataclass(frozen=True, slots=True)
class TrafficSeen:
    """Aircraft of others that vehicles' receivers report, as far as they were heard anew."""

    t_s: float
    tracks: tuple[Track, ...]
    kind: Literal["traffic_seen"] = "traffic_seen"


@dataclass(frozen=True, slots=True)
class Resumed:
    """The operator goes on with a mission that was interrupted."""

    t_s: float
    kind: Literal["resumed"] = "resumed"


VehicleEvent = (
    Connected
    | LiftedOff
    | Airborne
    | Tracked
    | Arrived
    | FrameSeen
    | Weighed
    | FrameLost
    | LookEnded
    | Landed
    | Crashed
    | Guarded
    | Navigated
    | BatterySwapped
    | Overridden
    | Released
    | LinkLost
    | GivenUp
    | OrderFailed
    | VehicleRecalled
    | CellSkipped
    | Told
    | Heard
    | Shared
    | Allotted
    | Apart
    | Asked
    | Leased
)
Event = VehicleEvent | Recalled | Paused | Continued | TrafficSeen | Resumed
AnyEvent = Annotated[Event, Field(discriminator="kind")]

_ADAPTER: TypeAdapter[Event] = TypeAdapter(AnyEvent)
_MAY_OVERFLOW: Final = re.compile(r"NaN|Infinity|\d[eE]\+?\d{2}|\d{300}")
"""What a text has in which a number may be no finite one."""


def to_json(event: Event) -> str:
    """The text of an event in the journal. Raises `EventError` for what no journal can hold."""
    try:
        # without a vantage is something that a frame says; elsewhere None is what nobody has said
        if isinstance(event, FrameSeen):
            unsaid = {
                key for key in ("overview", "unsure", "classes") if getattr(event, key) is None
            }
            data, nones = _ADAPTER.dump_json(event, exclude=unsaid), event.vantage is None
        else:
            data, nones = _ADAPTER.dump_json(event, exclude_none=True), False
        text = data.decode()
    except (PydanticSerializationError, UnicodeError) as error:
        raise EventError(f"{event.kind}: no text of an event: {error}") from None
    if data.count(b"null") > nones:  # a NaN and an infinity are written as null
        _refuse_what_json_cannot_hold(event)
    return text


def from_json(text: str) -> Event:
    """The inverse of `to_json`. Raises ValueError for anything else."""
    event = _ADAPTER.validate_json(text, strict=True)
    if _MAY_OVERFLOW.search(text):
        _refuse_what_json_cannot_hold(event)
    return event


def _refuse_what_json_cannot_hold(event: Event) -> None:
    """Raise `EventError` for a NaN or an infinity."""
    for field in fields(event):
        if not _finite(value := getattr(event, field.name)):
            raise EventError(f"{event.kind}: {field.name} = {value!r} is no finite number")


def _finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    return all(map(_finite, value)) if isinstance(value, tuple) else True
