"""MAVLink 2 signing as an ArduPilot does it (mavlink.io, "Message Signing").

A signature is the link id, a timestamp of 48 bits (10 microseconds since 2015) and the first six
bytes of a SHA-256 over key and frame. Timestamps only rise within a stream (system, component,
link id), which is what keeps a recorded frame from being played again.

The vehicle has no clock that agrees with its clients': its own timestamp is the highest that it
was given or has verified, one more with each frame it signs.
"""

from __future__ import annotations

import hashlib
import hmac

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec.wire import crc_extra_of

KEY_BYTES = 32
NEW_STREAM_BEHIND = 6_000_000
"""A new stream may begin one minute before the newest timestamp."""

_SIGNED = mav.MAVLINK_IFLAG_SIGNED
_MAX_STREAMS = 16  # as in the C library: further streams are refused
_MAX_TIMESTAMP = 2**48 - 1


class Signing:
    """Key, timestamp and streams of one vehicle, for all its links.

    >>> signing = Signing()
    >>> signing.active
    False
    >>> signing.set_up(b"k" * 32, timestamp=10)
    >>> signing.active, signing.timestamp
    (True, 10)
    """

    def __init__(self) -> None:
        self.timestamp = 0
        self._key: bytes | None = None
        self._streams: dict[tuple[int, int, int], int] = {}

    @property
    def active(self) -> bool:
        """There is a key: everything sent is signed, what comes in has to be."""
        return self._key is not None

    def set_up(self, key: bytes, timestamp: int) -> None:
        """Take a key of 32 bytes and the time it begins with.

        A key of zeros with the time 0 ends signing; with another time it is a key.
        """
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._streams.clear()
        self._key = key if any(key) or timestamp else None
        # a key must not be used again with timestamps that have been used
        self.timestamp = max(self.timestamp, min(timestamp, _MAX_TIMESTAMP))

    def accepts(self, frame: bytes | bytearray, trusted: bool) -> bool:
        """Whether a whole frame with a right checksum may be heard.

        `trusted`: on such a link (USB) everything is, and signatures are verified only to follow
        the streams.
        """
        if self._key is None:
            return True
        return self._verify(bytes(frame)) or trusted

    def _verify(self, frame: bytes) -> bool:
        if frame[0] != mav.PROTOCOL_MARKER_V2 or not frame[2] & _SIGNED:
            return False
        link_id, timestamp = frame[-13], int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], link_id)
        last = self._streams.get(stream)
        if last is None:
            if timestamp + NEW_STREAM_BEHIND < self.timestamp or len(self._streams) >= _MAX_STREAMS:
                return False
        elif timestamp <= last:
            return False
        if not hmac.compare_digest(self._digest(frame[:-6]), frame[-6:]):
            return False
        self._streams[stream] = timestamp
        self.timestamp = max(self.timestamp, timestamp)
        return True

    def sign(self, frame: bytes, link_id: int) -> bytes:
        """The signed frame of an unsigned one of ours; itself while there is no key."""
        if self._key is None:
            return frame
        self.timestamp = min(self.timestamp + 1, _MAX_TIMESTAMP)
        flagged = bytearray(frame[:-2])
        flagged[2] |= _SIGNED
        extra = crc_extra_of(int.from_bytes(frame[7:10], "little"))
        checksum = mav.x25crc(flagged[1:] + bytes([extra])).crc
        flagged += checksum.to_bytes(2, "little")
        flagged.append(link_id)
        flagged += self.timestamp.to_bytes(6, "little")
        return bytes(flagged) + self._digest(bytes(flagged))

    def _digest(self, signed_part: bytes) -> bytes:
        return hashlib.sha256((self._key or b"") + signed_part).digest()[:6]
