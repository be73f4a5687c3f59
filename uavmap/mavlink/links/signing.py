"""MAVLink 2 signing (mavlink.io, "Message Signing"): only frames with our key are accepted.

A signature is a link id, a timestamp of 48 bits (10 microseconds since 2015) and the first six
bytes of a SHA-256 over key and frame. Timestamps only rise within a stream (system, component, link
id), so that no recorded frame can be replayed. A file beside the key's, for its owner only, keeps
them over a restart. The key is written as 64 hexadecimal digits; no log and no error ever holds it.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import json
import os
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError

KEY_BYTES: Final = 32
EPOCH_UTC_S: Final = 1420070400
"""2015-01-01, the origin of timestamps, UTC s."""
TICKS_PER_S: Final = 100_000
NEW_STREAM_BEHIND: Final = 60 * TICKS_PER_S
"""Maximum lag of a new stream behind the newest timestamp: one minute."""
MAX_STREAMS: Final = 256
LINK_ID: Final = 0

UNSIGNED: Final = "not signed"
WRONG_KEY: Final = "signed with another key"
REPLAYED: Final = "signed, but older than the last frame: replayed"

_SIGNED: Final = mav.MAVLINK_IFLAG_SIGNED
_LAST_TICK: Final = 2**48 - 1
_SIGNATURE_BYTES: Final = 13

Stream = tuple[int, int, int]
"""System, component, link id."""


def ticks_now() -> int:
    """Return the time in the ticks of signatures."""
    return int((time.time() - EPOCH_UTC_S) * TICKS_PER_S)


class Signing:
    """A key and its timestamps, for all links of a process.

    The wall clock `now`, in ticks, may jump; timestamps do not follow it back.
    """

    def __init__(
        self, key: bytes, timestamps: KeptTimestamps, now: Callable[[], int] = ticks_now
    ) -> None:
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._stamps = timestamps
        self._now = now

    def __repr__(self) -> str:
        return "Signing(...)"  # never the key

    def next_tick(self) -> int:
        """Return a timestamp that was never used: now, or one more than the last."""
        tick = min(max(self._now(), self._stamps.sent + 1), _LAST_TICK)
        self._stamps.sent = tick
        self._stamps.note()
        return tick

    def sign(self, frame: bytes) -> bytes:
        """Return the signed frame of an unsigned MAVLink 2 frame."""
        flagged = bytearray(frame[:-2])
        flagged[2] |= _SIGNED
        extra = mav.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
        checksum = mav.x25crc(flagged[1:] + bytes([extra])).crc
        flagged += checksum.to_bytes(2, "little")
        flagged.append(LINK_ID)
        flagged += self.next_tick().to_bytes(6, "little")
        return bytes(flagged) + self._digest(flagged)

    def fault(self, frame: bytes) -> str | None:
        """Return why a whole frame with a right checksum is rejected; None if it is accepted.

        An accepted frame raises the timestamp of its stream.
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
        last = self._stamps.received.get(stream)
        if last is None:
            new = tick + NEW_STREAM_BEHIND >= self._stamps.sent
            if not new or len(self._stamps.received) >= MAX_STREAMS:
                return REPLAYED
        elif tick <= last:
            return REPLAYED
        self._stamps.received[stream] = tick
        self._stamps.note()
        return None

    def set_up(self, system: int, component: int) -> mav.MAVLink_setup_signing_message:
        """Return the message that gives a vehicle the key, and its first timestamp."""
        return mav.MAVLink_setup_signing_message(
            system, component, list(self._key), self.next_tick()
        )

    @staticmethod
    def removal(system: int, component: int) -> mav.MAVLink_setup_signing_message:
        """Return the message that ends signing.

        With another time than 0 an ArduPilot takes zeros for a key, which is public
        (GCS_Signing.cpp, `load_signing_key`).
        """
        return mav.MAVLink_setup_signing_message(system, component, [0] * KEY_BYTES, 0)

    def _digest(self, signed_part: bytes | bytearray) -> bytes:
        return hashlib.sha256(self._key + signed_part).digest()[:6]


BESIDE: Final = ".timestamps"
"""Ending of the file of timestamps."""
SAVE_S: Final = 2.0
"""Time between two writes of timestamps, real seconds."""
_AHEAD: Final = int(2 * SAVE_S * TICKS_PER_S)
"""Lead of the written timestamps over the used ones: a killed process used less."""
_MAX_CHARACTERS: Final = 4096


def new_key(path: Path) -> None:
    """Make a key in a new file that only its owner may read. Raises `LinkError`."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise LinkError(f"{path} exists already; a key is never overwritten") from None
    except OSError as error:
        raise LinkError(f"{path} cannot be made: {error.strerror}") from None
    with os.fdopen(file, "w") as opened:
        os.fchmod(opened.fileno(), 0o600)
        opened.write(secrets.token_hex(KEY_BYTES) + "\n")
        opened.flush()
        os.fsync(opened.fileno())


def read_key(path: Path) -> bytes:
    """Return the key in a file that only its owner may read and write.

    Raises `LinkError`, which never holds the content.
    """
    try:
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            text = file.read(_MAX_CHARACTERS)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise LinkError(
            f"{path}: the key cannot be read ({reason}); `uavmap keys new {path}` makes one"
        ) from None
    if stat.S_IMODE(found.st_mode) & 0o077:
        raise LinkError(
            f"{path}: others than its owner may use this key (mode "
            f"{stat.S_IMODE(found.st_mode):04o}); `chmod 600 {path}`, and make a new key if "
            "another user may have read it"
        )
    if found.st_uid != os.geteuid():
        raise LinkError(f"{path}: this key is another user's; make one of your own")
    try:
        key = bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES or not any(key):
        raise LinkError(f"{path} holds no key: {2 * KEY_BYTES} hexadecimal digits are expected")
    return key


class KeptTimestamps:
    """Timestamps in a file beside the key; a killed process used lower ones than the file's.

    Raises `LinkError` if they cannot be kept.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(key.name + BESIDE)
        self.sent = 0
        """Highest used timestamp, or more."""
        self.received: dict[Stream, int] = {}
        """Highest timestamp of each stream."""
        self._saved_s = float("-inf")
        self._reserved = 0
        self._read()
        self.save()

    def note(self) -> None:
        """Write a change, but not every time."""
        if self.sent >= self._reserved or time.monotonic() - self._saved_s >= SAVE_S:
            # a full disk must not end a flight; the write is tried again
            with contextlib.suppress(LinkError):
                self.save()

    def close(self) -> None:
        """Write the used timestamps, exactly."""
        with contextlib.suppress(LinkError):
            self.save(ahead=0)

    def save(self, ahead: int = _AHEAD) -> None:
        """Write the timestamps."""
        self._saved_s, self._reserved = time.monotonic(), self.sent + ahead
        received = {
            ":".join(map(str, stream)): tick for stream, tick in sorted(self.received.items())
        }
        text = json.dumps({"sent": self._reserved, "heard": received})
        temporary = self._path.with_name(self._path.name + ".new")
        try:
            temporary.write_text(text, "ascii")
            os.replace(temporary, self._path)
        except OSError as error:
            raise LinkError(
                f"{self._path} cannot be written: {error.strerror}; signing needs it to remember "
                "which timestamps were used; put the key where you may write"
            ) from None

    def _read(self) -> None:
        try:
            kept = json.loads(self._path.read_text("ascii"))
            self.sent = int(kept["sent"])
            for name, tick in kept["heard"].items():
                system, component, link = map(int, name.split(":"))
                self.received[system, component, link] = int(tick)
        except FileNotFoundError:
            return
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise LinkError(
                f"{self._path} is damaged; if no flight is under way, remove it: what was signed "
                "before could then be replayed for a minute"
            ) from None


@contextlib.contextmanager
def signing_with(path: str | None) -> Iterator[Signing | None]:
    """Yield signing with the key of a file, its timestamps kept; None without one.

    Raises `LinkError`.
    """
    if path is None:
        yield None
        return
    key = read_key(Path(path))
    timestamps = KeptTimestamps(Path(path))
    try:
        yield Signing(key, timestamps)
    finally:
        timestamps.close()
