"""One client's link at the vehicle's end: radio, framing and signing.

A vehicle has a link for each client, as an autopilot has ports; all carry the same telemetry.

Signing is MAVLink 2's as an ArduPilot does it (mavlink.io, "Message Signing"). A signature is the
link id, a timestamp of 48 bits (10 microseconds since 2015) and six bytes, the first of a SHA-256
over key and frame. Timestamps only rise within a stream (system, component, link id), so a recorded
frame cannot be replayed. The vehicle's clock does not agree with its clients'. Its timestamp is the
highest that it was given or has verified, plus one with each frame that it signs.
"""

from __future__ import annotations

import hashlib
import heapq
import hmac
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Cutter, Framer, Message, crc_extra_of, cut
from sitl.faults.faults import CLEAN, Faults, LinkQuality

KEY_BYTES = 32
NEW_STREAM_BEHIND = 6_000_000
"""Maximum lag of a new stream behind the newest timestamp: one minute."""

_SIGNED = mav.MAVLINK_IFLAG_SIGNED
_MAX_STREAMS = 16  # as in the C library: further streams are refused
_MAX_TIMESTAMP = 2**48 - 1


class Signing:
    """Key, timestamp and streams of one vehicle, for all its links."""

    def __init__(self) -> None:
        self.timestamp = 0
        self._key: bytes | None = None
        self._streams: dict[tuple[int, int, int], int] = {}

    @property
    def active(self) -> bool:
        """True if there is a key: all frames are signed in both directions."""
        return self._key is not None

    def set_up(self, key: bytes, timestamp: int) -> None:
        """Take a key of 32 bytes and its first timestamp.

        A key of zeros with the time 0 ends signing; with another time it is a key.
        """
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._streams.clear()
        self._key = key if any(key) or timestamp else None
        # a key must not be used again with timestamps that have been used
        self.timestamp = max(self.timestamp, min(timestamp, _MAX_TIMESTAMP))

    def accepts(self, frame: bytes | bytearray, trusted: bool) -> bool:
        """Return whether a whole frame with a right checksum is accepted.

        A `trusted` link (USB) accepts all, and verifies signatures only to follow the streams.
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
        """Sign a frame; without a key return it as it is."""
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


_OVERTAKEN_S = 0.1  # how far behind a frame falls that others overtake
_SOON_S = 1e-6
_MAX_WAITING = 20_000


class Lossy:
    """One direction of one link: loses, doubles, delays, reorders or garbles frames, by a seed.

    Times are the vehicle's.

    >>> radio = Lossy([1])
    >>> radio.put([b"one", b"two"], LinkQuality(delay_s=0.2), now_s=0.0)
    >>> radio.due(0.1), radio.due(0.2)
    ([], [b'one', b'two'])
    """

    def __init__(self, seed: Sequence[int]) -> None:
        self._rng = np.random.default_rng(list(seed))
        self._waiting: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._last_s = 0.0  # when the newest frame in order arrives: none behind it comes earlier

    @property
    def idle(self) -> bool:
        """True if no frame is on its way."""
        return not self._waiting

    def put(self, frames: Iterable[bytes], quality: LinkQuality, now_s: float) -> None:
        """Send frames at `now_s`; a queue that is too long loses them."""
        for frame in frames:
            # all fates are drawn for each frame, so that one setting does not shift another's
            lost, doubled, overtaken, garbled, late, where = self._rng.random(6).tolist()
            if quality.silent or lost < quality.loss:
                continue
            if frame and garbled < quality.corrupt:
                frame = _garble(frame, where)
            due_s = now_s + quality.delay_s + late * quality.jitter_s
            if overtaken < quality.reorder:
                due_s += max(_OVERTAKEN_S, quality.jitter_s)
            else:
                due_s = self._last_s = max(self._last_s, due_s)
            for _ in range(2 if doubled < quality.duplicate else 1):
                if len(self._waiting) < _MAX_WAITING:
                    heapq.heappush(self._waiting, (due_s, self._count, frame))
                    self._count += 1

    def due(self, now_s: float) -> list[bytes]:
        """Return the frames that arrive until `now_s`, in order."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now_s + _SOON_S:
            arrived.append(heapq.heappop(self._waiting)[2])
        return arrived

    def drop(self) -> None:
        """Lose all frames on the way."""
        self._waiting.clear()


def _garble(frame: bytes, where: float) -> bytes:
    at = int(where * len(frame))
    flip = 1 + int(where * 7919.0 * len(frame)) % 255
    return frame[:at] + bytes([frame[at] ^ flip]) + frame[at + 1 :]


_UP, _DOWN = 1, 2
_LINK_SEED = 41
_MAX_OUTBOX = 1 << 20  # of a client that does not take what it is sent


@dataclass(eq=False)
class Link:
    """One client's bytes, in by `receive` and out by `read`, in vehicle time.

    `link_id` marks its signatures. `trusted`: a USB cable, where unsigned frames are accepted.
    `texts_to_stations`: STATUSTEXT is sent only after a ground station's heartbeat.
    """

    link_id: int
    seed: tuple[int, int]
    faults: Faults
    signing: Signing
    handle: Callable[[list[Message]], None]
    trusted: bool
    texts_to_stations: bool

    def __post_init__(self) -> None:
        self._sends_texts = not self.texts_to_stations
        self._framer = Framer()
        self._cutter = Cutter()
        self._up = Lossy((*self.seed, _LINK_SEED, self.link_id, _UP))
        self._down = Lossy((*self.seed, _LINK_SEED, self.link_id, _DOWN))
        self._outbox = bytearray()

    def receive(self, data: bytes) -> None:
        """Take bytes from the client, in any pieces."""
        quality = self.faults.up
        if quality is CLEAN and self._up.idle and self._cutter.empty:
            self._listen(data)
            return
        self._up.put(self._cutter.feed(data), quality, self.faults.t_s)
        self._listen(b"".join(self._up.due(self.faults.t_s)))

    def read(self) -> bytes:
        """Return the bytes that have arrived at the client since the last call."""
        data = bytes(self._outbox)
        self._outbox.clear()
        return data

    def send(self, frames: bytes) -> None:
        """Send whole unsigned frames; what exceeds the client's outbox is lost."""
        if not self._sends_texts:
            frames = b"".join(frame for frame in cut(frames) if not _is_text(frame))
        quality = self.faults.down
        if quality is CLEAN and self._down.idle and not self.signing.active:
            self._arrive(frames)
            return
        signed = [self.signing.sign(frame, self.link_id) for frame in cut(frames)]
        self._down.put(signed, quality, self.faults.t_s)
        self._arrive(b"".join(self._down.due(self.faults.t_s)))

    def step(self) -> None:
        """Deliver what is due, in both directions."""
        if not self._up.idle:
            if self.faults.up.silent:
                self._up.drop()
            if data := b"".join(self._up.due(self.faults.t_s)):
                self._listen(data)
        if not self._down.idle:
            if self.faults.down.silent:
                self._down.drop()
            self._arrive(b"".join(self._down.due(self.faults.t_s)))

    def _listen(self, data: bytes) -> None:
        messages = self._framer.feed(data)
        if self.signing.active:
            messages = [
                message
                for message in messages
                if self.signing.accepts(message.get_msgbuf(), self.trusted)
            ]
        self._sends_texts = self._sends_texts or any(map(_is_station, messages))
        if messages:
            self.handle(messages)

    def _arrive(self, frames: bytes) -> None:
        if len(self._outbox) + len(frames) <= _MAX_OUTBOX:
            self._outbox += frames


def _is_text(frame: bytes) -> bool:
    """Return whether it is STATUSTEXT; the vehicle's own frames are of MAVLink 2."""
    return bool(int.from_bytes(frame[7:10], "little") == mav.MAVLINK_MSG_ID_STATUSTEXT)


def _is_station(message: Message) -> bool:
    return bool(message.get_type() == "HEARTBEAT" and message.type == mav.MAV_TYPE_GCS)
