"""The option of uavmap simulate that says how robots on the grid hear each other."""

from __future__ import annotations

import argparse
from typing import Final

from missions.errors import LinkError
from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from uavmap.lab.simulated_links import simulated_links

_HELP: Final = (
    "who knows what the others saw: shared (or free), all at once (default); meeting, only who "
    "stands at one vertex; or a radio, range:CELLS. After range:CELLS or shared, with commas: "
    "loss:SHARE, delay:TIME, rate:CELLS_A_UNIT_OF_TIME, apart:BEGIN-END (nobody hears "
    "anybody then; apart:10-30:1+2/3+4: only those in one group do)"
)


def add_comms_option(parser: argparse.ArgumentParser) -> None:
    """Add it; it has no default, so that it is known whether it was given."""
    parser.add_argument("--comms", metavar="HOW", help=_HELP)


def comms_of(options: argparse.Namespace, seed: int) -> Comms | Links:
    """Who tells whom what; the seed is of what is lost. Raises `LinkError`."""
    if options.comms is None:
        return Comms.SHARED
    try:
        return simulated_links(options.comms, options.robots, seed)
    except ValueError as error:
        raise LinkError(f"--comms {options.comms}: {error}") from None


def team_told(robots: int, radio: str | None) -> str:
    """How many robots, and over what radio they talk, if over one.

    >>> team_told(1, None), team_told(4, "range:8")
    ('1 robot', '4 robots, range:8')
    """
    told = f"{robots} robot" + "s" * (robots > 1)
    return told if radio is None else f"{told}, {radio}"
