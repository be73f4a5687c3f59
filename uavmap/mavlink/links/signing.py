"""MAVLink 2 signing (mavlink.io, "Message Signing"): only who has the key is believed.

A signature is a link id, a timestamp of 48 bits (units of 10 microseconds since 2015) and the first
six bytes of a SHA-256 over key and frame. Timestamps only rise within a stream (system, component,
link id): that is what keeps a recorded frame from being played again, also after a restart, for
which they are kept (`uavmap.mavlink.links.key_file`).
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

KEY_BYTES: Final = 32
EPOCH_UTC_S: Final = 1420070400
"""2015-01-01, from which timestamps are counted."""
TICKS_PER_S: Final = 100_000
NEW_STREAM_BEHIND: Final = 60 * TICKS_PER_S
"""A stream that was never heard may begin one minute before the newest timestamp."""
MOST_STREAMS: Final = 256
LINK_ID: Final = 0

UNSIGNED: Final = "not signed"
WRONG_KEY: Final = "signed with another key"
REPLAYED: Final = "signed, and older than what was heard: replayed"

_SIGNED: Final = mav.MAVLINK_IFLAG_SIGNED
_LAST_TICK: Final = 2**48 - 1
_SIGNATURE_BYTES: Final = 13

Stream = tuple[int, int, int]
"""System, component, link id."""


class Timestamps(Protocol):
    """What is remembered of timestamps, over restarts."""

    sent: int
    """The highest that was used, or more."""
    heard: dict[Stream, int]
    """The highest of each stream."""

    def note(self) -> None:
        """Something has changed."""
        ...


def ticks_now() -> int:
    """The time as signatures tell it."""
    return int((time.time() - EPOCH_UTC_S) * TICKS_PER_S)


class Signing:
    """A key and what was signed with it, for all links of a process.

    `now` is the wall clock in ticks; it may jump, the timestamps do not follow it back.
    """

    def __init__(
        self, key: bytes, timestamps: Timestamps, now: Callable[[], int] = ticks_now
    ) -> None:
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._stamps = timestamps
        self._now = now

    def __repr__(self) -> str:
        return "Signing(...)"  # never the key

    def next_tick(self) -> int:
        """A timestamp that was never used: now, or one more than the last."""
        tick = min(max(self._now(), self._stamps.sent + 1), _LAST_TICK)
        self._stamps.sent = tick
        self._stamps.note()
        return tick

    def sign(self, frame: bytes) -> bytes:
        """The signed frame of an unsigned MAVLink 2 frame of ours."""
        flagged = bytearray(frame[:-2])
        flagged[2] |= _SIGNED
        extra = mav.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
        checksum = mav.x25crc(flagged[1:] + bytes([extra])).crc
        flagged += checksum.to_bytes(2, "little")
        flagged.append(LINK_ID)
        flagged += self.next_tick().to_bytes(6, "little")
        return bytes(flagged) + self._digest(flagged)

    def fault(self, frame: bytes) -> str | None:
        """Why a whole frame with a right checksum is not believed; None if it is.

        What is believed raises the timestamp of its stream.
        """
        if (
            frame[0] != mav.PROTOCOL_MARKER_V2
            or not frame[2] & _SIGNED
            or len(frame) < mav.HEADER_LEN_V2 + 2 + _SIGNATURE_BYTES
        ):
            return UNSIGNED
        if not hmac.compare_digest(self._digest(frame[:-6]), frame[-6:]):
            return WRONG_KEY
        tick = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], frame[-13])
        last = self._stamps.heard.get(stream)
        if last is None:
            new = tick + NEW_STREAM_BEHIND >= self._stamps.sent
            if not new or len(self._stamps.heard) >= MOST_STREAMS:
                return REPLAYED
        elif tick <= last:
            return REPLAYED
        self._stamps.heard[stream] = tick
        self._stamps.note()
        return None

    def set_up(self, system: int, component: int) -> mav.MAVLink_setup_signing_message:
        """The message that gives a vehicle the key, and the time to begin with."""
        return mav.MAVLink_setup_signing_message(
            system, component, list(self._key), self.next_tick()
        )

    @staticmethod
    def removal(system: int, component: int) -> mav.MAVLink_setup_signing_message:
        """The message that ends signing: an ArduPilot takes a key of zeros with any other time than
        0 for a key (GCS_Signing.cpp, `load_signing_key`), which everybody knows then.
        """
        return mav.MAVLink_setup_signing_message(system, component, [0] * KEY_BYTES, 0)

    def _digest(self, signed_part: bytes | bytearray) -> bytes:
        return hashlib.sha256(self._key + signed_part).digest()[:6]
