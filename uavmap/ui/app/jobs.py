"""Commands that a page has begun: each a process of its own, whose lines lie in a file.

A page, or the program that serves it, may end at any time: its flights go on, as if they had been
begun at a terminal.
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
MOST_LINES: Final = 400
MOST_RUNNING: Final = 8
"""Commands that run beside each other: a small computer flies and does little else."""
_TAIL_BYTES: Final = 1 << 16
_HEAD_BYTES: Final = 1 << 16
"""A page is begun before all else: its URL is among the first lines."""
_PAGE: Final = re.compile(r"^(?:live page: |paint at )(http\S+)", re.MULTILINE)
_WATCHED: Final = re.compile(r"^live page without buttons: (http\S+)", re.MULTILINE)
"""The same, for those who only look."""
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
    """What follows `uavmap` on the command line."""
    log: Path
    process: subprocess.Popen[bytes]
    begun_s: float = field(default_factory=time.monotonic)
    _head: str = ""

    @property
    def shown(self) -> str:
        """Return the command as a terminal takes it."""
        return shown(self.words)

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    @property
    def state(self) -> str:
        """Return `running`, or how it ended."""
        code = self.process.poll()
        if code is None:
            return f"running, {time.monotonic() - self.begun_s:.0f} s"
        return _ENDS.get(code, "ended by a fault") + f" (exit code {code})"

    def lines(self) -> list[str]:
        """Return its last lines; what a terminal draws anew on one line counts as its last form."""
        try:
            with self.log.open("rb") as file:
                file.seek(max(file.seek(0, os.SEEK_END) - _TAIL_BYTES, 0))
                text = file.read().decode("utf-8", "replace")
        except OSError as error:
            return [f"{self.log}: cannot be read: {error.strerror}"]
        text = _TOKEN.sub("token=...", text)  # those who only look have no buttons
        return [line.rsplit("\r", 1)[-1] for line in text.splitlines()][-MOST_LINES:]

    def page(self, *, steers: bool) -> str | None:
        """Return the URL of the page that it serves; None before it has printed one, and after.

        Who does not hold the controls gets the page without buttons, where there are two.
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
        """Press Ctrl-C: a flight comes home and lands; a second one leaves it to its autopilot."""
        if self.runs:
            self.process.send_signal(signal.SIGINT)


class Jobs:
    """All commands of a page, in the folder where they run.

    `origin` is that of the page: it may show theirs.
    """

    def __init__(self, folder: Path, origin: str = "") -> None:
        self.folder = folder
        self._environment = {**os.environ, SHOWN_IN: origin, "PYTHONUNBUFFERED": "1"}
        self.all: list[Job] = []

    def begin(self, words: Sequence[str]) -> Job:
        """Run `uavmap` with these words. Raises `UavmapError` where that cannot be."""
        if len(self.running) >= MOST_RUNNING:
            raise UavmapError(f"{MOST_RUNNING} commands run already; end one of them first")
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
        """Return those that have not ended."""
        return [job for job in self.all if job.runs]


def shown(words: Sequence[str]) -> str:
    """Return a command as a terminal takes it.

    >>> shown(["check", "Field 1.toml"])
    "uavmap check 'Field 1.toml'"
    """
    return shlex.join(["uavmap", *words])
