"""Commands that the page has started: each in its own process, with its lines in a file.

The page, or the program that serves it, may end at any time. Its flights continue, as if started at
a terminal.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from missions.errors import UavmapError
from uavmap.base.framing import SHOWN_IN

LOGS: Final = ".uavmap-app"
"""Folder of the lines, in the workspace."""
MAX_LINES: Final = 400
MAX_RUNNING: Final = 8
"""Maximum number of commands at once, for small computers."""
_TAIL_BYTES: Final = 1 << 16
_HEAD_BYTES: Final = 1 << 16
"""Size of the first lines, bytes, among which is the URL of a page."""
_PAGE: Final = re.compile(r"^(?:live page: |paint at )(http\S+)", re.MULTILINE)
_WATCHED: Final = re.compile(r"^live page without buttons: (http\S+)", re.MULTILINE)
"""Line with the URL of a page without buttons."""
_TOKEN: Final = re.compile(r"\btoken=\S+")
_PAGED: Final = ("fly", "resume", "watch", "tune")
"""Commands that may serve a page."""
_ENDS: Final = {0: "done", 2: "refused", 3: "not complete", 4: "an aircraft is down",
                5: "no verdict", 130: "interrupted"}  # fmt: skip


@dataclass(slots=True)
class Job:
    """A command that runs, or has run."""

    number: int
    words: tuple[str, ...]
    """Arguments after `uavmap` on the command line."""
    log: Path
    process: subprocess.Popen[bytes]
    begun_s: float = field(default_factory=time.monotonic)
    _head: str = ""

    @property
    def shown(self) -> str:
        """Return the command as typed at a terminal."""
        return shown(self.words)

    @property
    def runs(self) -> bool:
        """True if it has not ended."""
        return self.process.poll() is None

    @property
    def state(self) -> str:
        """Return `running`, or its end in words."""
        code = self.process.poll()
        if code is None:
            return f"running, {time.monotonic() - self.begun_s:.0f} s"
        return _ENDS.get(code, "failed") + f" (exit code {code})"

    def lines(self) -> list[str]:
        """Return its last lines; of a line that is drawn again and again, the last text."""
        try:
            with self.log.open("rb") as file:
                file.seek(max(file.seek(0, os.SEEK_END) - _TAIL_BYTES, 0))
                text = file.read().decode("utf-8", "replace")
        except OSError as error:
            return [f"{self.log}: cannot be read: {error.strerror}"]
        text = _TOKEN.sub("token=...", text)  # browsers that watch must not get it
        return [line.rsplit("\r", 1)[-1] for line in text.splitlines()][-MAX_LINES:]

    def page(self, *, steers: bool) -> str | None:
        """Return the URL of the page that it serves; None before it is printed and after the end.

        A browser without the controls gets the page without buttons, if there is one.
        """
        if self.words[0] not in _PAGED or not self.runs:
            return None
        if _PAGE.search(self._head) is None:
            with contextlib.suppress(OSError), self.log.open("rb") as file:
                self._head = file.read(_HEAD_BYTES).decode("utf-8", "replace")
        page, watched = _PAGE.search(self._head), _WATCHED.search(self._head)
        if page is None or steers:
            return None if page is None else page[1]
        return (watched or page)[1]

    def interrupt(self) -> None:
        """Act as Ctrl-C: the aircraft return; a second one leaves that to their autopilots."""
        if self.runs:
            self.process.send_signal(signal.SIGINT)


class Jobs:
    """All commands of a page, in the folder where they run.

    `origin` is the origin of the page, which may show the pages of its commands.
    """

    def __init__(self, folder: Path, origin: str = "") -> None:
        self.folder = folder
        self._environment = {**os.environ, SHOWN_IN: origin, "PYTHONUNBUFFERED": "1"}
        self.all: list[Job] = []

    def begin(self, words: Sequence[str]) -> Job:
        """Run `uavmap` with these arguments. Raises `UavmapError` if that is impossible."""
        if len(self.running) >= MAX_RUNNING:
            raise UavmapError(f"{MAX_RUNNING} commands are running; end one of them first")
        try:
            return self._begin(words)
        except OSError as error:
            raise UavmapError(f"{shown(words)}: cannot be run: {error.strerror}") from None

    def _begin(self, words: Sequence[str]) -> Job:
        logs = self.folder / LOGS
        logs.mkdir(exist_ok=True)
        number = len(self.all) + 1
        log = logs / f"{time.strftime('%Y%m%dT%H%M%S')}-{number}.log"
        with log.open("wb") as out:
            process = subprocess.Popen(
                [sys.executable, "-m", "uavmap", *words],
                cwd=self.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
                start_new_session=True, env=self._environment,
            )  # fmt: skip
        job = Job(number, tuple(words), log, process)
        self.all.append(job)
        return job

    @property
    def running(self) -> list[Job]:
        """Return the commands that have not ended."""
        return [job for job in self.all if job.runs]


def shown(words: Sequence[str]) -> str:
    """Return a command as typed at a terminal.

    >>> shown(["check", "Field 1.toml"])
    "uavmap check 'Field 1.toml'"
    """
    return shlex.join(["uavmap", *words])
