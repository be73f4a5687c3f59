"""The journal: every event of a mission, a line of JSON each, in the order of their effects.

A line is on the disk before its event has an effect, also after a power cut. It carries its number
and a CRC-32 over itself and all lines before it, so changed, lost, doubled and reordered lines are
found. The checksums guard against accidents, not against forgery.
"""

from __future__ import annotations

import errno
import json
import os
import zlib
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from missions.errors import JournalError
from missions.events import Event, from_json, to_json
from uavmap.base.atomic_write import write_bytes
from uavmap.base.folder_lock import locked
from uavmap.base.version import __version__

FORMAT: Final = 1
COMPILED: Final = "compiled"
PLAIN: Final = "plain"
PLAN: Final = "plan"
_CHECKSUM: Final = b',"crc":"%08x"}'
_CHECKSUM_BYTES: Final = len(_CHECKSUM % 0)


def planner() -> str:
    """Return the planner of this installation: compiled by numba, or in plain Python."""
    return COMPILED if find_spec("numba") else PLAIN


@dataclass(frozen=True, slots=True)
class Position:
    """A place between two lines of a journal."""

    offset: int = 0
    lines: int = 0
    checksum: int = 0
    """CRC-32 of all lines before, without their own checksums."""
    events: int = 0

    def sealed(self, kind: str, text: bytes) -> tuple[bytes, Position]:
        """Return a line with this text of JSON, and the position after it."""
        head = b'{"seq":%d,"%s":%s' % (self.lines + 1, kind.encode(), text)
        checksum = zlib.crc32(head, self.checksum)
        line = head + _CHECKSUM % checksum + b"\n"
        events = self.events + (kind == "event")
        return line, Position(self.offset + len(line), self.lines + 1, checksum, events)

    def unsealed(self, line: bytes, kind: str) -> tuple[str, Position] | None:
        """Return the text of a line that fits here, and the position after it, else None."""
        prefix = b'{"seq":%d,"%s":' % (self.lines + 1, kind.encode())
        text = line[len(prefix) : -_CHECKSUM_BYTES]
        expected, after = self.sealed(kind, text)
        try:
            return (text.decode(), after) if expected[:-1] == line else None
        except UnicodeDecodeError:
            return None


class JournalReader:
    """Reader of a journal, also while another process writes it; it neither locks nor changes it.

    Raises `JournalError` if there is no journal, or none of this format.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.position = Position()
        line, end, _ = self._rest().partition(b"\n")
        opening = self.position.unsealed(line, "journal") if end else None
        if opening is None:
            if not line.startswith(b'{"seq":1,"journal":'):
                raise JournalError(f"{path} is not a journal of uavmap")
            raise JournalError(
                f"{path} is damaged in its first line; left as it is: no flight plan can be read"
            )
        text, self.position = opening
        values = json.loads(text)
        if values["format"] != FORMAT:
            raise JournalError(
                f"{path} has journal format {values['format']}, this program knows {FORMAT}: use "
                "the version of uavmap that wrote it"
            )
        self.planner: str = values["planner"]
        """`COMPILED` or `PLAIN`."""
        self.meta: dict[str, Any] = values["meta"]
        """Flight plan and later values, up to the last line read."""
        self.torn = False
        """True if the last line is incomplete; the next line that is written replaces it."""

    def new_events(self) -> list[Event]:
        """Return the events after those read before, in order.

        Raises `JournalError` at damage, after it has returned the events before the damage.
        """
        return [event for _, event in self._new()]

    def events(self) -> Iterator[Event]:
        """Return all events not read before. Raises as `new_events` does."""
        while piece := self.new_events():
            yield from piece

    def bodies(self) -> list[str]:
        """Return the JSON of all events not read before. Raises `JournalError`."""
        found: list[str] = []
        while piece := self._new():
            found.extend(body for body, _ in piece)
        return found

    def _new(self) -> list[tuple[str, Event]]:
        rest, found = self._rest(), list[tuple[str, Event]]()
        lines, end = rest.split(b"\n"), self.position.offset + len(rest)
        for number, line in enumerate(lines[:-1], 1):
            if (meta := self.position.unsealed(line, "meta")) is not None:
                self.meta.update(json.loads(meta[0]))
                self.position = meta[1]
                continue
            event = self.position.unsealed(line, "event")
            if event is None and not any(lines[number:]):
                break  # a kill or a power cut broke it before it was confirmed
            damage = f"line {self.position.lines + 1} is not as it was written"
            if event is not None:
                try:
                    found.append((event[0], from_json(event[0])))
                    self.position = event[1]
                    continue
                except ValueError:
                    damage = f"event {self.position.events + 1} cannot be read"
            if found:
                return found
            good = self.position.events
            raise JournalError(
                f"{self.path} is damaged: {damage}; left as it is: "
                f"{'1 event is' if good == 1 else f'{good} events are'} good, and "
                f"`uavmap resume {self.path.parent} --recover` goes on from there in a copy"
            )
        self.torn = self.position.offset < end
        return found

    def _rest(self) -> bytes:
        try:
            with self.path.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                if size < self.position.offset:
                    raise JournalError(f"{self.path} was exchanged for another; read it anew")
                file.seek(self.position.offset)
                return file.read(size - self.position.offset)
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            raise JournalError(
                f"{self.path}: there is no journal here; give the folder that a flight wrote to"
            ) from None
        except (OSError, ValueError) as error:
            raise JournalError(f"{self.path} cannot be read: {_reason(error)}") from None


class Journal(JournalReader, AbstractContextManager["Journal"]):
    """An open journal, written by this process alone. Use `create` or `open`, and close it."""

    def __init__(self, path: Path, opening: bytes | None = None) -> None:
        with ExitStack() as held:
            held.callback(os.close, lock(path))
            if opening is not None:
                _begin(path, opening)
            super().__init__(path)
            deque(super().events(), maxlen=0)
            try:
                self._file = os.open(path, os.O_RDWR)
            except OSError as error:
                raise JournalError(
                    f"{path} is whole, but cannot be opened for writing: {error.strerror}"
                ) from None
            held.callback(os.close, self._file)
            self._held = held.pop_all()
        self._expected: deque[str] = deque()

    @classmethod
    def create(cls, path: Path, meta: Mapping[str, Any]) -> Journal:
        """Make a new journal, and its folder.

        Raises `JournalError` when there is one already. A process that is killed in here leaves no
        journal, or a whole one.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            raise JournalError(f"{path.parent} cannot be made: {_reason(error)}") from None
        opening = {
            "format": FORMAT, "version": __version__, "planner": planner(), "meta": dict(meta)
        }  # fmt: skip
        return cls(path, Position().sealed("journal", _json(opening).encode())[0])

    @classmethod
    def open(cls, path: Path) -> Journal:
        """Open an existing journal. Raises `JournalError`, and changes nothing, if it is
        damaged."""
        JournalReader(path)  # before the lock: a missing journal is reported first
        return cls(path)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; everything in it was safe before."""
        self._held.close()

    def discard(self) -> None:
        """Close and remove a journal without events. Raises `JournalError`."""
        if len(self):
            raise JournalError(f"{self.path} holds events and is not removed")
        self.close()
        self.path.unlink(missing_ok=True)

    def __len__(self) -> int:
        """Return the number of events."""
        return self.position.events

    def bodies(self) -> list[str]:
        """Return the JSON of the events, in order."""
        return JournalReader(self.path).bodies()

    def events(self) -> Iterator[Event]:
        """Return the events in order."""
        return JournalReader(self.path).events()

    def put_meta(self, key: str, value: Any) -> None:
        """Set a value of the mission as a whole, except its plan. Raises `JournalError`."""
        if key == PLAN:
            raise ValueError("the flight plan of a journal does not change")
        text = _json({key: value})
        self._write("meta", [text])
        self.meta.update(json.loads(text))

    def append(self, event: Event) -> None:
        """Commit an event; when this returns, it is on the disk.

        Raises `EventError` for an event that cannot be recorded (the journal is as before, and
        continues), `JournalError` when the disk refuses.
        """
        body = to_json(event)
        if not self._expected:
            self._write("event", [body])
        elif body != (recorded := self._expected.popleft()):
            raise JournalError(
                f"{self.path}: the simulated flight does not repeat itself (recorded: {recorded}; "
                f"now: {body}); was it flown with another version? "
                f"`uavmap resume {self.path.parent} --from-home` goes on without repeating it"
            )

    def append_all(self, events: Iterable[Event]) -> None:
        """Commit several events by one write; on an error keep none. Raises as `append` does."""
        self._write("event", map(to_json, events))

    def _write(self, kind: str, texts: Iterable[str]) -> None:
        lines, end = [], self.position
        for text in texts:
            line, end = end.sealed(kind, text.encode())
            lines.append(line)
        try:
            if self.torn:
                os.ftruncate(self._file, self.position.offset)
            self.torn = True
            write_at(self._file, self.position.offset, b"".join(lines))
            os.fsync(self._file)
        except OSError as error:  # a full disk, mostly
            with suppress(OSError):  # else before the next write
                os.ftruncate(self._file, self.position.offset)
            raise JournalError(f"{self.path} cannot be written: {error.strerror}") from None
        self.torn, self.position = False, end

    def start_verification(self) -> None:
        """Have `append` compare events with those in the file, until all have come again.

        So a simulated flight is resumed, whose world is made again from the seed.
        """
        self._expected = deque(self.bodies())

    @property
    def expected(self) -> int:
        """Number of recorded events that are still to come again."""
        return len(self._expected)


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _reason(error: OSError | ValueError) -> object:
    return getattr(error, "strerror", None) or error


# --- the file --------------------------------------------------------------------------------
def lock(path: Path) -> int:
    """Lock the folder for this process: two would fly the same aircraft. The kernel unlocks."""
    try:
        return locked(path.parent)
    except BlockingIOError:
        raise JournalError(f"{path} is in use by another uavmap; end that first") from None
    except OSError as error:
        raise JournalError(f"{path} cannot be opened: {error.strerror}") from None


def _begin(path: Path, line: bytes) -> None:
    try:
        if path.exists():
            raise JournalError(
                f"{path} exists already; go on with `uavmap resume {path.parent}`, "
                "or choose another --out"
            )
        install(path, line)
        to_disk(path.parent.absolute().parent)
    except OSError as error:
        raise JournalError(f"{path} cannot be written: {error.strerror}") from None


def install(path: Path, data: bytes) -> None:
    """Install a file whole, or not at all, under the caller's lock. Raises `OSError`."""
    for left in path.parent.glob(f".{path.name}.*"):  # a process was killed in here
        left.unlink()
    write_bytes(path, data)
    to_disk(path.parent)


def write_at(file: int, offset: int, data: bytes) -> None:
    """Write all of the data. Raises `OSError`."""
    view = memoryview(data)
    while view:
        count = os.pwrite(file, view, offset)
        offset, view = offset + count, view[count:]


def to_disk(folder: Path) -> None:
    """Force the names in a folder to the disk. Raises `OSError`."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # some file systems (network, FAT) cannot sync a folder
        if error.errno not in (errno.EINVAL, errno.EBADF):
            raise
    finally:
        os.close(handle)
