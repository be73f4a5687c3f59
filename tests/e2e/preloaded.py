"""The command as a process that need not import itself anew.

Most of what a short run of `uavmap` costs is its imports. So one process for each worker of the
tests imports the command once and makes a copy of itself for every run (`preloading`). The copy has
a process id, arguments, a working directory, signals, standard streams and an end of its own, and
goes through the same `main` as the command from a shell. `rig.command` is the latter, for tests
that look at the beginning itself.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

_ROOT = Path(__file__).resolve().parents[2]
_MOST_BYTES = 1 << 16


class Process:
    """A run of the command, with what the tests use of `subprocess.Popen`."""

    def __init__(
        self, arguments: Sequence[str], environment: Mapping[str, str], cwd: Path | None = None
    ) -> None:
        """Start `uavmap` with these arguments."""
        self.args = ["uavmap", *arguments]
        self.returncode: int | None = None
        self._end, told = socket.socketpair()
        out, out_end = os.pipe()
        err, err_end = os.pipe()
        self.stdout: IO[str] = open(out, encoding="utf-8", errors="replace")  # noqa: SIM115
        self.stderr: IO[str] = open(err, encoding="utf-8", errors="replace")  # noqa: SIM115
        asked = {
            "arguments": list(arguments),
            "environment": dict(environment),
            "cwd": str(cwd or Path.cwd()),
        }
        handed = [out_end, err_end, told.fileno()]
        try:
            control = _server()
            socket.send_fds(control, [json.dumps(asked).encode()], handed)
            self.pid = int(control.recv(_MOST_BYTES))
        finally:
            told.close()
            os.close(out_end)
            os.close(err_end)

    def poll(self) -> int | None:
        """The exit code, negative for a signal, or None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end. Raises `subprocess.TimeoutExpired`."""
        if self.returncode is None:
            if not select.select([self._end], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
            status = self._end.recv(_MOST_BYTES)
            assert status, "the process that starts the runs is gone"
            self._end.close()
            self.returncode = os.waitstatus_to_exitcode(int(status))
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # it has ended, and we are not told yet
                os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for the end; what was printed. Raises `subprocess.TimeoutExpired`."""
        due_s = None if timeout is None else time.monotonic() + timeout
        texts = ["", ""]

        def read(which: int, stream: IO[str]) -> None:
            with contextlib.suppress(ValueError):  # closed, for it was read before
                texts[which] = stream.read()

        readers = [
            threading.Thread(target=read, args=pair, daemon=True)
            for pair in enumerate((self.stdout, self.stderr))
        ]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join(None if due_s is None else max(due_s - time.monotonic(), 0.0))
            if reader.is_alive():
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        self.wait(None if due_s is None else max(due_s - time.monotonic(), 0.0))
        self.stdout.close()
        self.stderr.close()
        return texts[0], texts[1]


@functools.cache
def _server() -> socket.socket:
    """The process that starts the runs of this worker of the tests; its socket."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        # it ends when our end of the socket is closed, at the latest with this process
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.e2e.preloading", str(theirs.fileno())],
            cwd=_ROOT,
            env={**os.environ, "PYTHONPATH": str(_ROOT)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
        )

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours
