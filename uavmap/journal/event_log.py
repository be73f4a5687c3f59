"""The journal: every event of a mission, a line of JSON each, in the order of its effects.

A line is on the disk before its event has an effect, also after a power cut. It carries its number
and a CRC-32 over itself and all lines before it, so changed, lost, doubled and reordered lines
show. The checksums guard against accidents, not against forgery.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import zlib
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Self

from missions.errors import JournalError
from missions.events import Event, from_json, to_json
from uavmap.base.version import __version__

FORMAT: Final = 1
COMPILED: Final = "compiled"
PLAIN: Final = "plain"
PLAN: Final = "plan"
_CHECKSUM: Final = b',"crc":"%08x"}'
_CHECKSUM_BYTES: Final = len(_CHECKSUM % 0)


def planner() -> str:
    """Return how this installation plans: compiled by numba, or in plain Python."""
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
        """Return the text of a line that belongs here, and the position after it, else None."""
        prefix = b'{"seq":%d,"%s":' % (self.lines + 1, kind.encode())
        text = line[len(prefix) : -_CHECKSUM_BYTES]
        expected, after = self.sealed(kind, text)
        return (text.decode(), after) if expected[:-1] == line else None


class JournalReader:
    """Read a journal, also while another process writes it; neither locks nor changes it.

    Raises `JournalError` where there is no journal, or none of this format.
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
        """How that installation planned: `COMPILED` or `PLAIN`."""
        self.meta: dict[str, Any] = values["meta"]
        """What the mission was started with, as of what was read."""
        self.torn = False
        """Whether the last line was cut short when it was read last."""

    def new_events(self) -> list[Event]:
        """Return the events after those that were read before, in order.

        Raises `JournalError` at damage, after the events before it were returned.
        """
        return [event for _, event in self._new()]

    def events(self) -> Iterator[Event]:
        """Return all events that were not read before. Raises as `new_events` does."""
        while piece := self.new_events():
            yield from piece

    def bodies(self) -> list[str]:
        """Return the texts of all events that were not read before. Raises `JournalError`."""
        found: list[str] = []
        while piece := self._new():
            found.extend(body for body, _ in piece)
        return found

    def _new(self) -> list[tuple[str, Event]]:
        rest = self._rest()
        lines, found = rest.split(b"\n"), list[tuple[str, Event]]()
        for number, line in enumerate(lines[:-1]):
            if (meta := self.position.unsealed(line, "meta")) is not None:
                self.meta.update(json.loads(meta[0]))
                self.position = meta[1]
                continue
            event = self.position.unsealed(line, "event")
            try:
                if event is not None:
                    found.append((event[0], from_json(event[0])))
                    self.position = event[1]
                    continue
                damage = f"line {self.position.lines + 1} is not as it was written"
            except ValueError:
                damage = f"event {self.position.events + 1} cannot be read"
            if event is None and not any(lines[number + 1 :]):
                break  # a kill or a power cut took it before it was confirmed
            if found:
                return found
            raise JournalError(self._described(damage))
        self.torn = self.position.offset < self._size
        return found

    def _rest(self) -> bytes:
        try:
            with self.path.open("rb") as file:
                self._size = os.fstat(file.fileno()).st_size
                if self._size < self.position.offset:
                    raise JournalError(f"{self.path} was exchanged for another; read it anew")
                file.seek(self.position.offset)
                return file.read(self._size - self.position.offset)
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            raise JournalError(
                f"{self.path}: there is no journal here; give the folder that a flight wrote to"
            ) from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise JournalError(f"{self.path} cannot be read: {reason}") from None

    def _described(self, damage: str) -> str:
        good = self.position.events
        return (
            f"{self.path} is damaged: {damage}; left as it is: "
            f"{'1 event is' if good == 1 else f'{good} events are'} good, and "
            f"`uavmap resume {self.path.parent} --recover` goes on from there in a copy"
        )


class Journal:
    """An open journal. Use `create` or `open`; close it, or use it as a context manager."""

    def __init__(self, path: Path, file: int, held: int, reader: JournalReader) -> None:
        self.path = path
        self.meta = reader.meta
        """What the mission was started with, and what was put since."""
        self.planner = reader.planner
        self.torn = reader.torn
        """Whether the file ends in a line that was cut short; the next one takes its place."""
        self._file = file
        self._lock = held
        self._end = reader.position
        self._closed = False
        self._expected: deque[str] = deque()

    @classmethod
    def create(cls, path: Path, meta: Mapping[str, Any]) -> Journal:
        """Make a new journal, and its folder. Raises `JournalError` when there is one already.

        A process that is killed in here leaves no journal, or a whole one.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise JournalError(f"{path.parent} cannot be made: {reason}") from None
        opening = {
            "format": FORMAT, "version": __version__, "planner": planner(), "meta": dict(meta)
        }  # fmt: skip
        held = lock(path)
        try:
            if path.exists():
                raise JournalError(
                    f"{path} exists already; go on with `uavmap resume {path.parent}`, "
                    "or choose another --out"
                )
            install(path, Position().sealed("journal", _json(opening).encode())[0])
            to_disk(path.parent.absolute().parent)
            return cls._opened(path, held)
        except OSError as error:
            os.close(held)
            raise JournalError(f"{path} cannot be written: {error.strerror}") from None
        except BaseException:
            os.close(held)
            raise

    @classmethod
    def open(cls, path: Path) -> Journal:
        """Open an existing journal. Raises `JournalError` for anything that is not a whole one,
        and leaves that as it is."""
        JournalReader(path)  # before the lock: where there is no journal that is what is said
        held = lock(path)
        try:
            return cls._opened(path, held)
        except BaseException:
            os.close(held)
            raise

    @classmethod
    def _opened(cls, path: Path, held: int) -> Journal:
        reader = JournalReader(path)
        deque(reader.events(), maxlen=0)
        try:
            return cls(path, os.open(path, os.O_RDWR), held, reader)
        except OSError as error:
            raise JournalError(
                f"{path} is whole, but cannot be opened for writing: {error.strerror}"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; everything in it was safe before."""
        if not self._closed:
            self._closed = True
            os.close(self._file)
            os.close(self._lock)

    def discard(self) -> None:
        """Close and remove a journal in which nothing has happened. Raises `JournalError`."""
        if len(self):
            raise JournalError(f"{self.path} holds events and is not removed")
        self.close()
        self.path.unlink(missing_ok=True)

    def __len__(self) -> int:
        """Return how many events it holds."""
        return self._end.events

    def bodies(self) -> list[str]:
        """Return the texts of the events, in order."""
        return JournalReader(self.path).bodies()

    def events(self) -> Iterator[Event]:
        """Return the events in order."""
        return JournalReader(self.path).events()

    def put_meta(self, key: str, value: Any) -> None:
        """Change what is said of the mission as a whole, not its plan. Raises `JournalError`."""
        if key == PLAN:
            raise ValueError("the flight plan of a journal does not change")
        text = _json({key: value})
        self._write("meta", [text])
        self.meta.update(json.loads(text))

    def append(self, event: Event) -> None:
        """Commit an event; when this returns, it is on the disk.

        Raises `EventError` for an event that cannot be written down (the journal is as before, and
        goes on), `JournalError` when the disk refuses.
        """
        body = to_json(event)
        if self._expected:
            self._verify(body)
        else:
            self._write("event", [body])

    def append_all(self, events: Iterable[Event]) -> None:
        """Commit events at once, for what did not happen just now; raises as `append` does, and
        none of them is kept then."""
        self._write("event", map(to_json, events))

    def _write(self, kind: str, texts: Iterable[str]) -> None:
        lines, end = [], self._end
        for text in texts:
            line, end = end.sealed(kind, text.encode())
            lines.append(line)
        try:
            if self.torn:
                os.ftruncate(self._file, self._end.offset)
            self.torn = True
            write_at(self._file, self._end.offset, b"".join(lines))
            os.fsync(self._file)
        except OSError as error:  # a full disk, mostly
            with suppress(OSError):  # else before the next one
                os.ftruncate(self._file, self._end.offset)
            raise JournalError(f"{self.path} cannot be written: {error.strerror}") from None
        self.torn, self._end = False, end

    def start_verification(self) -> int:
        """Let the events that are in the file be appended again, and check each.

        This is how a simulated flight is resumed: its world died with the process and is made
        again from the seed, so every event must come out as it was recorded. Returns how many
        events are expected; from then on `append` writes.
        """
        self._expected = deque(self.bodies())
        return len(self._expected)

    @property
    def expected(self) -> int:
        """How many recorded events are still to come again."""
        return len(self._expected)

    def _verify(self, body: str) -> None:
        recorded = self._expected.popleft()
        if body != recorded:
            raise JournalError(
                f"{self.path}: the simulated flight does not repeat itself (recorded: {recorded}; "
                f"now: {body}); was it flown with another version? "
                f"`uavmap resume {self.path.parent} --from-home` goes on without repeating it"
            )


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


# --- the file --------------------------------------------------------------------------------
def lock(path: Path) -> int:
    """Hold the folder for one process: two would fly the same aircraft. The kernel lets go."""
    try:
        folder = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise JournalError(f"{path} cannot be opened: {error.strerror}") from None
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(folder)
        why = "" if isinstance(error, BlockingIOError) else f" ({error.strerror})"
        raise JournalError(f"{path} is in use by another uavmap; end that first{why}") from None
    return folder


def unfinished(path: Path) -> Path:
    """Return the name under which a file is written until it is whole."""
    return path.with_name(path.name + ".unfinished")


def install(path: Path, data: bytes) -> None:
    """Put a file in its place, whole and on the disk, or not at all. The caller holds the lock.

    Raises `OSError`.
    """
    temporary = unfinished(path)
    try:
        file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        try:
            write_at(file, 0, data)
            os.fsync(file)
        finally:
            os.close(file)
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
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
        # some file systems (network, FAT) cannot do it for a folder
        if error.errno not in (errno.EINVAL, errno.EBADF):
            raise
    finally:
        os.close(handle)
