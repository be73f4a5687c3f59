"""The process that makes a copy of itself for every run of the command: see `preloaded`."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import signal
import socket
import sys
from pathlib import Path
from typing import Any

from missions.planning.sweep.memo import warm_up
from uavmap.__main__ import main
from uavmap.load.mission_source import load
from uavmap.runner.simulation import make_vehicles
from uavmap.ui import cli

cli.parser()  # imports every command

_MOST_BYTES = 1 << 16
_HANDED = 3
_ANY_MISSION = Path(__file__).resolve().parents[1] / "data" / "speck.toml"
_SEED = 1
"""Of a simulated flight that is not told another."""


def _serve(control: socket.socket) -> dict[str, Any] | None:
    """Start runs until nobody asks any more. Returns in each of them, with what was asked."""
    waking, woken = socket.socketpair()
    for end in (waking, woken):
        end.setblocking(False)
    signal.set_wakeup_fd(woken.fileno())
    signal.signal(signal.SIGCHLD, lambda *_: None)
    ends: dict[int, int] = {}
    while True:
        ready, _, _ = select.select([control, waking], [], [])
        if waking in ready:
            waking.recv(_MOST_BYTES)
            _tell_ends(ends)
        if control in ready:
            body, handed, _, _ = socket.recv_fds(control, _MOST_BYTES, _HANDED)
            if not body:
                return None
            out, err, told = handed
            pid = os.fork()
            if pid == 0:
                for mine in (control, waking, woken):
                    mine.close()
                for fd in (told, *ends.values()):
                    os.close(fd)
                os.dup2(out, 1)
                os.dup2(err, 2)
                os.close(out)
                os.close(err)
                asked: dict[str, Any] = json.loads(body)
                return asked
            ends[pid] = told
            os.close(out)
            os.close(err)
            control.send(str(pid).encode())


def _tell_ends(ends: dict[int, int]) -> None:
    for pid in list(ends):
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            with socket.socket(fileno=ends.pop(pid)) as told, contextlib.suppress(OSError):
                told.send(str(status).encode())


def _prepare() -> None:
    """Have in memory what nearly every flight would load or compute anew: the planner's kernels,
    and the patterns of the ground, which depend on the seed only."""
    warm_up()
    world = make_vehicles(load(str(_ANY_MISSION)), _SEED)[0].world
    assert world.ground_texture.size == world.roi_texture.size


def _run() -> int:
    _prepare()
    gc.collect()
    gc.freeze()
    asked = _serve(socket.socket(fileno=int(sys.argv[1])))
    if asked is None:
        return 0
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    # as an interpreter that begins with these streams would have made them
    sys.stdout = sys.__stdout__ = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.__stderr__ = open(  # noqa: SIM115
        2, "w", encoding="utf-8", errors="backslashreplace", buffering=1, closefd=False
    )
    os.chdir(asked["cwd"])
    os.environ.clear()
    os.environ.update(asked["environment"])
    sys.argv = ["uavmap", *asked["arguments"]]
    return main()


if __name__ == "__main__":
    sys.exit(_run())
