"""A process of this program beside a flight: its start and its complaints."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Collection
from pathlib import Path
from typing import Final

_REMEMBERED: Final = 4096
"""Maximum bytes of its standard error that are kept."""


class Child:
    """A module of this program in a process of its own, fed through `stdin`.

    A thread reads its standard error. `pass_fds` are open files that it inherits.
    """

    def __init__(self, module: str, name: str, pass_fds: Collection[int] = ()) -> None:
        here = str(Path(__file__).parents[2])  # the child has to find this very program
        paths = [here, *filter(None, [os.environ.get("PYTHONPATH")])]
        self.process = subprocess.Popen(
            # -P: a folder `missions` in the working folder must not be imported instead of ours
            [sys.executable, "-P", "-m", module],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=pass_fds,
            start_new_session=True,  # Ctrl-C is for the flight
        )
        process = self.process
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self.stdin, self.stdout, self._stderr = process.stdin, process.stdout, process.stderr
        self._complaint = b""
        self._listener = threading.Thread(target=self._listen, name=f"{name}-errors", daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            while piece := os.read(self._stderr.fileno(), _REMEMBERED):
                self._complaint = (self._complaint + piece)[-_REMEMBERED:]

    def last_words(self, wait_s: float = 0.0) -> str:
        """Return its last line on standard error, or no text; wait up to `wait_s` real seconds."""
        self._listener.join(wait_s)
        lines = self._complaint.decode(errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else ""

    def close(self, wait_s: float) -> None:
        """Close its files once they are read, after its end, or after `wait_s`."""
        self._listener.join(wait_s)
        for pipe in (self.stdout, self._stderr):
            with contextlib.suppress(OSError):
                pipe.close()
