"""`python -m uavmap` is the command `uavmap`, and this is where it begins."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
from pathlib import Path
from typing import NoReturn

INTERRUPTED = 130


def main() -> int:
    """Run the command; returns the exit code. Ctrl-C is heard from the beginning."""
    gc.disable()  # until all is loaded: that leaves no garbage
    # its threads wait for each other by spinning, and the last bits depend on their number
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from uavmap.ui import cli  # noqa: PLC0415 - this takes seconds on a small computer

        return cli.main()
    except KeyboardInterrupt:
        with contextlib.suppress(OSError):
            print("uavmap: interrupted", file=sys.stderr)
        return INTERRUPTED


def run() -> NoReturn:
    """Run the command and end this process with its exit code.

    The interpreter's end may take seconds, and resets signals that are handled, but not those that
    are ignored: a late Ctrl-C would replace the exit code.
    """
    try:
        code = main()
    finally:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        _let_go_of_output()
    sys.exit(code)


def _let_go_of_output() -> None:
    """Write out what is buffered; where nobody reads it any more, drop it.

    Else the interpreter tries at its very end, and its failure replaces our exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _drop_working_folder() -> None:
    """`python -m` looks for modules where somebody works first: a file `vision.py` there is not
    ours. Where the program itself lies there, it stays."""
    here, first = Path(__file__).resolve().parents[1], sys.path[0]
    if not sys.flags.safe_path and Path(first).resolve() == Path.cwd() != here:
        del sys.path[0]


if __name__ == "__main__":
    _drop_working_folder()
    run()
