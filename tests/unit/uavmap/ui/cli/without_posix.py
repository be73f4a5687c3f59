"""Run a command without the modules and signals of POSIX, as on Windows.

    python -m tests.unit.uavmap.ui.cli.without_posix check runway

`msvcrt` stands in for that of Windows, whose call has the same meaning.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import importlib.abc
import multiprocessing.connection
import os
import signal
import subprocess
import sys
import tempfile
import types
from typing import Any

MODULES = ("termios", "fcntl", "resource", "tty", "pty", "pwd", "grp")
STANDARD = (asyncio, concurrent.futures, multiprocessing.connection, subprocess, tempfile)
"""Modules loaded before: Python's own modules behave differently on Windows."""
SIGNALS = ("SIGHUP", "SIGUSR1", "SIGUSR2", "SIGCONT", "SIGALRM", "SIGPIPE", "SIGKILL", "SIGTTOU",
           "SIGWINCH", "SIGQUIT", "SIGTSTP")  # fmt: skip
FUNCTIONS = ("fork", "setsid", "killpg", "getuid", "geteuid", "fchmod", "sched_getaffinity")


class Hidden(importlib.abc.MetaPathFinder):
    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> None:
        if fullname in MODULES:
            raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)


def hide() -> None:
    for name in MODULES:
        sys.modules.pop(name, None)
    for name in SIGNALS:
        delattr(signal, name)
    for name in FUNCTIONS:
        delattr(os, name)
    msvcrt: Any = types.ModuleType("msvcrt")
    msvcrt.LK_NBLCK = 2
    msvcrt.locking = lambda file, mode, size: None
    sys.modules["msvcrt"] = msvcrt
    sys.meta_path.insert(0, Hidden())


if __name__ == "__main__":
    hide()
    from uavmap.ui.cli import main

    sys.exit(main(sys.argv[1:]))
