"""`python -m uavmap` is the command `uavmap`, and this is where it begins."""

from __future__ import annotations

import sys

INTERRUPTED = 130


def main() -> int:
    """Run the command; returns the exit code. Ctrl-C is heard from the beginning."""
    try:
        from uavmap import cli  # noqa: PLC0415 - this takes seconds on a small computer

        return cli.main()
    except KeyboardInterrupt:
        print("uavmap: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
