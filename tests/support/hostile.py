"""Bytes that no client should send: noise, broken frames, and fields with the worst values."""

from __future__ import annotations

import gc
import math
import random
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.vehicle import SimVehicle

RANGES = {
    "uint8_t": (0, 2**8 - 1), "int8_t": (-(2**7), 2**7 - 1), "char": (0, 127),
    "uint16_t": (0, 2**16 - 1), "int16_t": (-(2**15), 2**15 - 1),
    "uint32_t": (0, 2**32 - 1), "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1), "int64_t": (-(2**63), 2**63 - 1),
    "uint8_t_mavlink_version": (0, 255),
}  # fmt: skip
REALS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-40, -0.0, 65535.0, 2.0**31, -1e9)
NAMES = (b"", b"\xff" * 16, b"RTL_ALT\xfe\xfd", b"NO_SUCH_NAME", b"%n%s%n", b"\x00RTL_ALT")

# valid commands with any parameters, so they are no garbage
PLAIN_COMMANDS = (
    mav.MAV_CMD_NAV_LAND, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_MISSION_START,
)  # fmt: skip
_TARGETS = ("target_system", "target")


class Hostile:
    """A source of hostile bytes for the vehicle `system`, the same for the same seed."""

    def __init__(self, seed: int, system: int = 1) -> None:
        self.rng = random.Random(seed)
        self.system = system
        self._link = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self._types = sorted(mav.mavlink_map)
        self._commands = sorted(mav.enums["MAV_CMD"])

    def chunks(self, well_addressed: bool) -> Iterator[tuple[str, bytes]]:
        """Yield (kind, bytes) without end; messages to the vehicle itself only if requested."""
        kinds = [self.noise, self.truncated, self.flipped, self.unknown, self.foreign]
        kinds += [self.addressed] if well_addressed else []
        while True:
            kind = self.rng.choice(kinds)
            yield kind.__name__, kind()

    def noise(self) -> bytes:
        """Return random bytes, with more frame markers among them than chance has."""
        data = bytearray(self.rng.randbytes(self.rng.randrange(1, 600)))
        for _ in range(self.rng.randrange(4)):
            at = self.rng.randrange(len(data))
            data[at : at + 3] = bytes([self.rng.choice((0xFD, 0xFE)), self.rng.randrange(256), 0])
        return bytes(data)

    def truncated(self) -> bytes:
        frame = self._frame(self._fill(self._any_type(), wrong_target=False))
        return frame[: self.rng.randrange(1, len(frame))]

    def flipped(self) -> bytes:
        frame = bytearray(self._frame(self._fill(self._any_type(), wrong_target=False)))
        frame[self.rng.randrange(1, len(frame))] ^= self.rng.randrange(1, 256)
        # with a wrong version or length it may swallow the following bytes
        return bytes(frame)

    def unknown(self) -> bytes:
        """Return a message that the dialect does not have."""
        size = self.rng.randrange(256)
        number = self.rng.choice((59_999, 0xFFFFFF, self.rng.randrange(70_000, 2**24)))
        header = bytes([0xFD, size, 0, 0, self.rng.randrange(256), 255, 190])
        return header + number.to_bytes(3, "little") + self.rng.randbytes(size + 2)

    def foreign(self) -> bytes:
        """Return a whole message with any values, for another vehicle."""
        return self._frame(self._fill(self._any_type(targeted=True), wrong_target=True))

    def addressed(self) -> bytes:
        """Return a whole message with the worst values, for this vehicle."""
        kind = self._any_type()
        while kind.msgname in ("SETUP_SIGNING", "SET_MODE"):
            kind = self._any_type()
        return self._frame(self._fill(kind, wrong_target=False))

    def every_type(self, wrong_target: bool) -> Iterator[bytes]:
        for number in self._types:
            kind = mav.mavlink_map[number]
            if wrong_target and not set(_TARGETS) & set(kind.fieldnames):
                continue
            if kind.msgname not in ("SETUP_SIGNING", "SET_MODE"):
                yield self._frame(self._fill(kind, wrong_target))

    def _any_type(self, targeted: bool = False) -> Any:
        while True:
            # half of them are commands and similar messages, which have most effects
            often = ("COMMAND_LONG", "COMMAND_INT", "PARAM_SET", "MISSION_ITEM_INT",
                     "MISSION_COUNT", "SET_POSITION_TARGET_GLOBAL_INT")  # fmt: skip
            number = self.rng.choice(self._types)
            if self.rng.random() < 0.5:
                name = self.rng.choice(often)
                number = getattr(mav, f"MAVLINK_MSG_ID_{name}")
            kind = mav.mavlink_map[number]
            if not targeted or set(_TARGETS) & set(kind.fieldnames):
                return kind

    def _fill(self, kind: Any, wrong_target: bool) -> Any:
        values = []
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        for name, field in zip(kind.fieldnames, kind.fieldtypes, strict=True):
            if name in _TARGETS:
                others = (self.system + 1, 255, 77)
                values.append(self.rng.choice(others if wrong_target else (0, self.system)))
            elif name == "command" and kind.msgname.startswith("COMMAND"):
                values.append(self._command())
            elif field == "char" and lengths[name] > 0:
                values.append(self.rng.choice(NAMES)[: lengths[name]])
            elif lengths[name] > 0:
                values.append([self._value(field) for _ in range(lengths[name])])
            elif field == "char":
                values.append(bytes([self.rng.randrange(1, 127)]))
            else:
                values.append(self._value(field))
        return kind(*values)

    def _command(self) -> int:
        while True:
            known = self.rng.random() < 0.8
            command = self.rng.choice(self._commands) if known else self._value("uint16_t")
            if command not in PLAIN_COMMANDS:
                return min(command, 65535)

    def _value(self, field: str) -> Any:
        if field in ("float", "double"):
            return self.rng.choice(REALS)
        low, high = RANGES[field]
        return self.rng.choice((low, high, high - 1, 65535 & high, self.rng.randint(low, high)))

    def _frame(self, message: Any) -> bytes:
        version_1 = message.get_msgId() < 256 and self.rng.random() < 0.1
        frame = message.pack(self._link, force_mavlink1=version_1)
        self._link.seq = (self._link.seq + 1) & 0xFF
        return bytes(frame)


@dataclass(frozen=True)
class Outcome:
    sent: dict[str, int]
    crashes: list[str]
    changes: list[str]
    grown_bytes: int


def bombard(vehicle: SimVehicle, size: int, seed: int, *, well_addressed: bool) -> Outcome:
    """Give a vehicle `size` hostile bytes while its time passes, and check its state afterwards.

    Memory is compared between the first fifth, when all buffers are full, and the end.
    """
    hostile = Hostile(seed, vehicle.spec.system_id)
    before = condition(vehicle)
    sent: dict[str, int] = {}
    crashes: list[str] = []
    total, settled_bytes = 0, None
    tracemalloc.start()
    for number, (kind, data) in enumerate(hostile.chunks(well_addressed)):
        try:
            vehicle.receive(data)
            if number % 20 == 0:
                vehicle.step(0.05)
        except Exception as error:  # the test looks for exactly this error
            crashes.append(f"{kind}: {type(error).__name__}: {error}: {data.hex()[:200]}")
        sent[kind] = sent.get(kind, 0) + len(data)
        total += len(data)
        if settled_bytes is None and total >= size // 5:
            gc.collect()
            settled_bytes = tracemalloc.get_traced_memory()[0]
        if total >= size or len(crashes) > 20:
            break
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - (settled_bytes or 0)
    tracemalloc.stop()
    after = condition(vehicle)
    changes = [
        f"{key}: {before[key]} -> {after[key]}" for key in before if before[key] != after[key]
    ]
    return Outcome(sent, crashes, changes, grown)


def condition(vehicle: SimVehicle) -> dict[str, Any]:
    """Return mode, armed, place (to the metre) and every parameter."""
    truth = vehicle.truth
    east, north = vehicle.world.plane.to_plane(truth.position)
    place = (round(east), round(north), round(truth.height_m))
    parameters = vehicle._ap.parameters
    values = {p.name: parameters[p.name] for p in parameters.table}
    return {"mode": truth.mode, "armed": truth.armed, "place": place, **values}
