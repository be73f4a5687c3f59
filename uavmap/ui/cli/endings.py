"""How every command ends: exit codes, and a line on standard error. It imports nothing heavy."""

from __future__ import annotations

import contextlib
import sys
from typing import Final

USER_ERROR: Final = 2
INCOMPLETE: Final = 3
AIRCRAFT_DOWN: Final = 4
INTERRUPTED: Final = 130
NOBODY_READS: Final = 141
"""As a shell tells of a program that a closed pipe has ended."""


def complain(line: str) -> None:
    """A line of ours on standard error, if anybody reads it still."""
    with contextlib.suppress(OSError):
        print(f"uavmap: {line}", file=sys.stderr)
