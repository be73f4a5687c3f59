"""The command as a process that need not import itself again.

Most of the time of a short run of `uavmap` is spent on imports. So the standard library's fork
server imports the command once (`preloading`), and each run is a fork of it. A fork has a process
id, arguments, a working directory, signals, standard streams and an end of its own. It runs the
same `main` as the command from a shell. Tests of the start itself use `rig.command`, which runs
from a shell.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO
from unittest import mock

_ROOT = Path(__file__).resolve().parents[2]
_RUNS = multiprocessing.get_context("forkserver")
_RUNS.set_forkserver_preload([__name__, "tests.e2e.preloading"])


class Process:
    """A run of the command, with the methods of `subprocess.Popen` that the tests use."""

    def __init__(
        self,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        cwd: Path | None = None,
        room_bytes: int = resource.RLIM_INFINITY,
        stops_at: int | None = None,
    ) -> None:
        """Start a run.

        `room_bytes` limits the size of each of its files, as on a full disk. When its journal holds
        `stops_at` events, it stops until it is continued or killed.
        """
        self.args = ["uavmap", *arguments]
        with mock.patch.dict(os.environ, PYTHONPATH=str(_ROOT)):
            forkserver.ensure_running()
        (out, out_end), (err, err_end) = _RUNS.Pipe(duplex=False), _RUNS.Pipe(duplex=False)
        told = (self.args, dict(environment), str(cwd or Path.cwd()), room_bytes, stops_at,
            out_end, err_end)  # fmt: skip
        self._process = _RUNS.Process(target=_run, args=told)
        self._process.start()
        self.stdout, self.stderr = _text(out), _text(err)
        for end in (out, out_end, err, err_end):
            end.close()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """Return the exit code, negative for a signal, or None while it runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end. Raises `subprocess.TimeoutExpired`."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # ended, and not yet reported
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for the end; return the output. Raises `subprocess.TimeoutExpired`."""
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


def _text(end: Connection) -> IO[str]:
    return open(os.dup(end.fileno()), encoding="utf-8", errors="replace")


def _run(
    arguments: list[str],
    environment: dict[str, str],
    cwd: str,
    room_bytes: int,
    stops_at: int | None,
    out: Connection,
    err: Connection,
) -> None:
    """Run the command, in the fork."""
    os.setsid()  # a Ctrl-C is sent to all processes of a run, as by a terminal of its own
    resource.setrlimit(resource.RLIMIT_FSIZE, (room_bytes, room_bytes))
    for end, number in ((out, 1), (err, 2)):
        os.dup2(end.fileno(), number)
        end.close()
    # as an interpreter that begins with these streams would have made them
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(  # noqa: SIM115
        2, "w", encoding="utf-8", errors="backslashreplace", buffering=1, closefd=False
    )
    vars(sys).update(__stdout__=sys.stdout, __stderr__=sys.stderr)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = arguments
    from uavmap.__main__ import run  # noqa: PLC0415 - loaded by now

    if stops_at is not None:
        _stop_at(stops_at)
    run()


def _stop_at(count: int) -> None:
    from uavmap.journal.event_log import Journal  # noqa: PLC0415 - loaded by now

    write = Journal._write
    # a signal from before the wait is not lost, as it is on a process that stops itself
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCONT})

    def stopping(journal: Journal, kind: str, texts: Iterable[str]) -> None:
        before = len(journal)
        write(journal, kind, texts)
        if before < count <= len(journal):
            signal.sigwait({signal.SIGCONT})

    setattr(Journal, "_write", stopping)  # noqa: B010 - a method that mypy lets nobody assign
