"""Start of the command `uavmap`, which is also `python -m uavmap`."""

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
    """Run the command; return the exit code. Ctrl-C is handled from the beginning."""
    gc.disable()  # until all is loaded, which leaves no garbage
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

    The interpreter's end may take seconds. It resets signals that are handled, but not those that
    are ignored: a late Ctrl-C would replace the exit code.
    """
    try:
        code = main()
    finally:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        _flush_output()
    sys.exit(code)


def _flush_output() -> None:
    """Write out buffered text; drop it if there is no reader any more.

    Otherwise the interpreter tries at its very end, and its failure replaces our exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _drop_working_folder() -> None:
    """Drop the working folder, where `python -m` looks for modules first.

    A file `vision.py` there is not ours. The folder stays if the program itself is in it.
    """
    here, first = Path(__file__).resolve().parents[1], sys.path[0]
    if not sys.flags.safe_path and Path(first).resolve() == Path.cwd() != here:
        del sys.path[0]


if __name__ == "__main__":
    _drop_working_folder()
    run()
