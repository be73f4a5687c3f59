"""One client's link at the vehicle's end: framing, signing and a radio that may be bad.

    bytes from the client -> radio -> frames -> signature -> the vehicle
    the vehicle's frames -> signature -> radio -> bytes for the client

A vehicle has a link a client, as an autopilot has ports; all hear the same telemetry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec.wire import Cutter, Framer, Message, cut
from sitl.faults.faults import Faults
from sitl.faults.lossy_radio import CLEAN, Lossy
from sitl.mavlink.signing import Signing

_UP, _DOWN = 1, 2
_LINK_SEED = 41
_MAX_OUTBOX = 1 << 20  # of a client that does not take what it is sent


@dataclass(eq=False)
class Link:
    """Bytes in by `receive`, bytes out by `take`, in vehicle time.

    `link_id` marks its signatures. `trusted`: a USB cable, where unsigned frames are heard.
    `texts_to_stations`: STATUSTEXT goes out only once a ground station's heartbeat came in.
    """

    link_id: int
    seed: tuple[int, int]
    faults: Faults
    signing: Signing
    hear: Callable[[list[Message]], None]
    trusted: bool
    texts_to_stations: bool

    def __post_init__(self) -> None:
        self._tells_texts = not self.texts_to_stations
        self._framer = Framer()
        self._cutter = Cutter()
        self._up = Lossy((*self.seed, _LINK_SEED, self.link_id, _UP))
        self._down = Lossy((*self.seed, _LINK_SEED, self.link_id, _DOWN))
        self._outbox = bytearray()

    def receive(self, data: bytes) -> None:
        """Bytes from the client, in any pieces."""
        quality = self.faults.up
        if quality is CLEAN and self._up.idle and self._cutter.empty:
            self._listen(data)
            return
        self._up.put(self._cutter.feed(data), quality, self.faults.t_s)
        self._listen(b"".join(self._up.due(self.faults.t_s)))

    def take(self) -> bytes:
        """What has arrived at the client since the last call: whole frames, if none is garbled."""
        data = bytes(self._outbox)
        self._outbox.clear()
        return data

    def send(self, frames: bytes) -> None:
        """Whole unsigned frames from the vehicle; more than a client takes are lost."""
        if not self._tells_texts:
            frames = b"".join(frame for frame in cut(frames) if not _is_text(frame))
        quality = self.faults.down
        if quality is CLEAN and self._down.idle and not self.signing.active:
            self._arrive(frames)
            return
        signed = [self.signing.sign(frame, self.link_id) for frame in cut(frames)]
        self._down.put(signed, quality, self.faults.t_s)
        self._arrive(b"".join(self._down.due(self.faults.t_s)))

    def step(self) -> None:
        """Let arrive what is due now, in both directions."""
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
        self._tells_texts = self._tells_texts or any(map(_is_station, messages))
        if messages:
            self.hear(messages)

    def _arrive(self, frames: bytes) -> None:
        if len(self._outbox) + len(frames) <= _MAX_OUTBOX:
            self._outbox += frames


def _is_text(frame: bytes) -> bool:
    """STATUSTEXT; the vehicle's own frames are all of MAVLink 2."""
    return bool(int.from_bytes(frame[7:10], "little") == mav.MAVLINK_MSG_ID_STATUSTEXT)


def _is_station(message: Message) -> bool:
    return bool(message.get_type() == "HEARTBEAT" and message.type == mav.MAV_TYPE_GCS)
