"""Options of uavmap simulate that only robots take that watch each other."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any, Final

from missions.errors import StrategyError
from missions.lab.cooperation.trapezoids import Cover
from uavmap.lab.cooperation_trials import Mode
from uavmap.ui.cli.common import number_type

MOST_TOGETHER: Final = 5
_OWN: Final = ("cooperate", "range", "theta", "cover")
_OTHERS: Final = (
    "cells", "count", "cell_m", "strategy", "speed", "drift", "comms", "tree", "footprint", "accel",
    "frame_s", "error_rate", "loss_rate", "box_factor", "offline",
)  # fmt: skip
"""What an exploration of cells takes, and this one does not."""


def add_cooperation_options(parser: argparse.ArgumentParser) -> None:
    """Add what only --polygon takes; none has a default here."""
    group = parser.add_argument_group(
        "robots that watch each other",
        "with --polygon: one moves while others see it; path, exchanges, map, errors of place",
    )
    add = group.add_argument
    add("--cooperate", choices=[mode.value for mode in Mode], help="how the polygon is explored")
    add(
        "--range",
        metavar="M",
        type=number_type(float, 0.01, 1e5),
        help="how far a robot sees, metres",
    )
    add(
        "--theta",
        metavar="DEG",
        type=number_type(float, 1.0, 170.0),
        help="what a move takes up for who watches it, 1 to 170 degrees (default 60)",
    )
    add(
        "--cover",
        choices=[cover.value for cover in Cover],
        help="of trapezoid: what a move covers (default triangles)",
    )


def refuse_cooperation_options(options: argparse.Namespace) -> None:
    """Raise `StrategyError` where one of them is given without a polygon."""
    for name in _given(options, _OWN):
        raise StrategyError(f"--{name} is for --polygon FILE")


def checked_robots(options: argparse.Namespace) -> int:
    """How many robots explore a polygon together.

    Raises `StrategyError` for what is missing, and for what does not go together.
    """
    for name, choose in (("cooperate", ", ".join(Mode)), ("range", "metres that a robot sees")):
        if getattr(options, name) is None:
            raise StrategyError(f"--polygon needs --{name}: {choose}")
    for name in _given(options, _OTHERS):
        raise StrategyError(
            f"--{name.replace('_', '-')} is for --roi and --generate, not --polygon"
        )
    if options.index:
        raise StrategyError("--index is for ROIs, not for --polygon")
    mode = Mode(options.cooperate)
    if options.theta is not None and mode is Mode.TRIANGULATION:
        raise StrategyError("--theta is for stripes: --cooperate trapezoid or column")
    if options.cover is not None and mode is not Mode.TRAPEZOID:
        raise StrategyError("--cover is for --cooperate trapezoid")
    few, most = (3, MOST_TOGETHER) if mode is Mode.COLUMN else (2, 2)
    robots = int(few if options.robots is None else options.robots)
    if not few <= robots <= most:
        remedy = {Mode.COLUMN: "two are for --cooperate trapezoid"}
        raise StrategyError(
            f"--robots {robots}: {mode} takes {few if few == most else f'{few} to {most}'}; "
            + remedy.get(mode, f"three to {MOST_TOGETHER} are for --cooperate column")
        )
    return robots


def _given(options: argparse.Namespace, names: Sequence[str]) -> list[str]:
    found: list[Any] = [name for name in names if getattr(options, name) is not None]
    return found
