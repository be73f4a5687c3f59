"""Files with a signing key: for its owner only, with the timestamps that were used beside it.

The key is written as 64 hexadecimal digits. Neither a log nor a message of an error ever holds it.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from missions.errors import LinkError
from uavmap.mavlink.links.signing import KEY_BYTES, TICKS_PER_S, Signing, Stream

BESIDE: Final = ".timestamps"
"""Ending of the file in which timestamps are kept."""
SAVE_S: Final = 2.0
"""Real seconds between two times that timestamps are written."""
_AHEAD: Final = int(2 * SAVE_S * TICKS_PER_S)
"""What is written is so far ahead of what was used: whatever a killed process used is less."""
_MOST_CHARACTERS: Final = 4096


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
    """The key in a file. Raises `LinkError`, which never holds what is in it.

    Refused is a file that somebody else may read or write, or that is somebody else's.
    """
    try:
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            text = file.read(_MOST_CHARACTERS)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise LinkError(
            f"{path}: the key cannot be read ({reason}); `uavmap keys new {path}` makes one"
        ) from None
    if stat.S_IMODE(found.st_mode) & 0o077:
        raise LinkError(
            f"{path}: others than its owner may use this key (mode "
            f"{stat.S_IMODE(found.st_mode):04o}); `chmod 600 {path}`, and make a new key if "
            "somebody may have read it"
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
    """Timestamps in a file beside the key. Raises `LinkError` where they cannot be kept.

    A process that is killed has used none that is higher than what the file says.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(key.name + BESIDE)
        self.sent = 0
        self.heard: dict[Stream, int] = {}
        self._saved_s = float("-inf")
        self._reserved = 0
        self._read()
        self.save()

    def note(self) -> None:
        """Something has changed: write it down, but not every time."""
        if self.sent >= self._reserved or time.monotonic() - self._saved_s >= SAVE_S:
            # in flight a full disk must not end the flight; it is tried again
            with contextlib.suppress(LinkError):
                self.save()

    def close(self) -> None:
        """Write down what was used, exactly."""
        with contextlib.suppress(LinkError):
            self.save(ahead=0)

    def save(self, ahead: int = _AHEAD) -> None:
        """Write them down."""
        self._saved_s, self._reserved = time.monotonic(), self.sent + ahead
        heard = {":".join(map(str, stream)): tick for stream, tick in sorted(self.heard.items())}
        text = json.dumps({"sent": self._reserved, "heard": heard})
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
            text = self._path.read_text("ascii")
        except FileNotFoundError:
            return
        except (OSError, ValueError):
            raise self._damaged() from None
        try:
            kept = json.loads(text)
            self.sent = int(kept["sent"])
            for name, tick in kept["heard"].items():
                system, component, link = map(int, name.split(":"))
                self.heard[system, component, link] = int(tick)
        except (ValueError, KeyError, TypeError, AttributeError):
            raise self._damaged() from None

    def _damaged(self) -> LinkError:
        return LinkError(
            f"{self._path} is damaged; if no flight is under way, remove it: what was signed "
            "before could then be replayed for a minute"
        )


@contextlib.contextmanager
def signing_with(path: str | None) -> Iterator[Signing | None]:
    """Signing with the key of a file, its timestamps kept; None without one. Raises `LinkError`."""
    if path is None:
        yield None
        return
    key = read_key(Path(path))
    timestamps = KeptTimestamps(Path(path))
    try:
        yield Signing(key, timestamps)
    finally:
        timestamps.close()
