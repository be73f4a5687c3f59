"""`python -m uavmap` is the command `uavmap`, and this is where it begins."""

from __future__ import annotations

import contextlib
import os
import sys

INTERRUPTED = 130


def main() -> int:
    """Run the command; returns the exit code. Ctrl-C is heard from the beginning."""
    try:
        from uavmap import cli  # noqa: PLC0415 - this takes seconds on a small computer

        return cli.main()
    except KeyboardInterrupt:
        with contextlib.suppress(OSError):
            print("uavmap: interrupted", file=sys.stderr)
        return INTERRUPTED
    finally:
        _let_go_of_output()


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


if __name__ == "__main__":
    sys.exit(main())
