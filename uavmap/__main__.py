"""`python -m uavmap` is the command `uavmap`."""

from __future__ import annotations

import sys

from uavmap.cli import main

if __name__ == "__main__":
    sys.exit(main())
