"""What a process of this program beside a flight is started with."""

from __future__ import annotations

import os
from pathlib import Path

import uavmap


def environment() -> dict[str, str]:
    """The environment in which such a process finds this very program."""
    here = str(Path(uavmap.__file__).parents[1])
    paths = [here, *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
