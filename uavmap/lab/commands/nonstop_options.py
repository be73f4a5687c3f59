"""Options of uavmap simulate that only strategies take that do not stop over cells."""

from __future__ import annotations

import argparse
from typing import Any, Final

from missions.errors import StrategyError
from missions.planning.sweep.strategies import NONSTOP
from uavmap.ui.cli.common import number_type

DEFAULTS: Final[dict[str, Any]] = {
    "footprint": "15",
    "accel": 2.5,
    "frame_s": 0.2,
    "error_rate": 0.0,
    "loss_rate": 0.0,
    "box_factor": None,
    "offline": False,
}
"""By option. The parser has none, so that it is known which were given."""


def add_nonstop_options(parser: argparse.ArgumentParser) -> None:
    """Add what only strategies take that do not stop; none has a default here, see `DEFAULTS`."""
    group = parser.add_argument_group(
        f"{' and '.join(NONSTOP)}",
        "flight without stopping, in seconds and metres, from the start cell back to it",
    )
    add = group.add_argument
    add("--footprint", metavar="M[,M]", help="what a frame shows, m east and north (default 15)")
    accel = number_type(float, 0.1, 20.0)
    add("--accel", metavar="A", type=accel, help="acceleration, m/s^2 (default 2.5)")
    frame_s = number_type(float, 0.02, 10.0)
    add("--frame-s", metavar="S", type=frame_s, help="from frame to frame (default 0.2)")
    rate = number_type(float, 0.0, 0.4)
    add("--error-rate", metavar="P", type=rate, help="of votes that are wrong (default 0)")
    add("--loss-rate", metavar="P", type=rate, help="of frames that are lost (default 0)")
    add(
        "--box-factor",
        metavar="F",
        type=number_type(float, 1.0, 20.0),
        help="box of a survey: F times as wide as the region (default: 2 cells beyond it)",
    )
    add("--offline", action="store_true", default=None, help="a reference that knows the region")


def refuse_nonstop_options(options: argparse.Namespace) -> None:
    """Raise `StrategyError` where one of them is given and no strategy takes it."""
    for name in DEFAULTS:
        if getattr(options, name) is not None:
            raise StrategyError(
                f"--{name.replace('_', '-')} is for --strategy {' or '.join(NONSTOP)}"
            )
