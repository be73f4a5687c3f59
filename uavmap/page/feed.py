"""The process of a page, from the side of the flight: fed by a thread, listened to, ended.

The flight never waits for it. What it is told goes into a short queue that a thread writes to the
process; while that is full nothing more is put in, and the next delta holds what was left out.
"""

from __future__ import annotations

import contextlib
import os
import queue
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Final

from missions.errors import OutputError
from uavmap.child_process import environment
from uavmap.page.pipe import Lines, Words, packed

START_S: Final = 60.0
"""Real seconds in which the page must be ready; it takes some 3 on a small computer."""
END_S: Final = 6.0
"""Real seconds in which its process takes in what it was told last, and ends."""
WAITING: Final = 8
"""So many messages may wait to be written."""


class Feed:
    """A page's process under way.

    `say` gets a line when it ends before its time; called from the thread that calls `put`.
    """

    def __init__(self, config: Words, listening: socket.socket, say: Callable[[str], None]) -> None:
        self._say = say
        self._messages: queue.Queue[bytes | None] = queue.Queue(WAITING)
        self._lines = Lines()
        self._dead = self._told = False
        self._complaint = b""
        self._process = subprocess.Popen(
            # -P: a folder `missions` where somebody works must not be taken for ours
            [sys.executable, "-P", "-m", "uavmap.page.child"],
            env=environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=(listening.fileno(),),
            start_new_session=True,  # Ctrl-C is for the flight
        )
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self.put({"kind": "start", "socket": listening.fileno(), **config})
        self._writer = threading.Thread(target=self._write, name="page", daemon=True)
        self._listener = threading.Thread(target=self._listen, name="page-errors", daemon=True)
        self._writer.start()
        self._listener.start()

    def wait_ready(self) -> None:
        """Return when it can be looked at. Raises `OutputError` where it does not begin."""
        due_s = time.monotonic() + START_S
        why = f"it was not ready within {START_S:g} s"
        while (left_s := due_s - time.monotonic()) > 0.0:
            select.select([self.orders_file], [], [], min(left_s, 0.5))
            for words in self.orders():
                if words.get("ready"):
                    return
                why = str(words.get("failed", why))
            if self._process.poll() is not None:
                self._listener.join(END_S)
                why = self._last_words() or f"its process ended with {self._process.returncode}"
                break
        raise OutputError(f"the live page does not begin: {why}")

    # --- there -----------------------------------------------------------------------------
    @property
    def idle(self) -> bool:
        """Whether it has taken nearly everything that it was told."""
        return not self._dead and self._messages.qsize() <= 1

    def put(self, words: Words, data: bytes = b"", *, wait_s: float = 0.0) -> bool:
        """Tell it something, unless too much waits; whether it is told.

        `wait_s`: for who has nothing else to do, how long to wait for room, real seconds.
        """
        if self._dead:
            self._tell()
            return False
        try:
            self._messages.put(packed(words, data), wait_s > 0.0, wait_s or None)
        except queue.Full:
            return False
        return True

    def _write(self) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        try:
            while (message := self._messages.get()) is not None:
                pipe.write(message)
                pipe.flush()
        except (OSError, ValueError):
            self._dead = True
        finally:
            with contextlib.suppress(OSError, ValueError):
                pipe.close()

    def _tell(self) -> None:
        if not self._told:
            self._told = True
            why = self._last_words() or "its process has ended"
            self._say(f"the live page is gone ({why}); the flight goes on without it")

    # --- back ------------------------------------------------------------------------------
    @property
    def orders_file(self) -> int:
        """Readable when there are orders."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    def orders(self) -> list[Words]:
        """What has come since it was asked last; none from a page that is gone."""
        try:
            piece = os.read(self.orders_file, 1 << 16)
        except BlockingIOError:
            return []
        except (OSError, ValueError):
            piece = b""
        if not piece:
            self._dead = True
        return self._lines.of(piece)

    @property
    def dead(self) -> bool:
        """Whether it is gone."""
        return self._dead

    @property
    def pid(self) -> int:
        """The number of its process on this machine."""
        return self._process.pid

    def _listen(self) -> None:
        """Take what it complains of, so that it never waits for a reader."""
        pipe = self._process.stderr
        assert pipe is not None
        with contextlib.suppress(OSError, ValueError):
            while piece := os.read(pipe.fileno(), 4096):
                self._complaint = (self._complaint + piece)[-4096:]

    def _last_words(self) -> str:
        lines = self._complaint.decode(errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else ""

    # --- over ------------------------------------------------------------------------------
    def close(self) -> None:
        """End it; what it was told last it still takes in, if it is quick."""
        with contextlib.suppress(queue.Full):
            self._messages.put(None, timeout=0.0 if self._dead else END_S)
        self._writer.join(END_S)
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._dead = True
        self._listener.join(END_S)
        for pipe in (self._process.stdout, self._process.stderr):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()
