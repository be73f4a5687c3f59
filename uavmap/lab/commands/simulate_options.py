"""Options of uavmap simulate for certain strategies.

These do not stop over cells, localize, or watch each other. The parser has no defaults for them: so
it is known which were given.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any, Final

from missions.errors import LocalizationError, StrategyError, UavmapError
from missions.lab.cooperation.trapezoids import Cover
from missions.lab.localization.methods import METHODS, Method
from missions.lab.localization.noisy_run import Errors
from missions.lab.localization.pose_belief import EXACT, Noise
from missions.planning.sweep.strategies import NONSTOP
from uavmap.lab.cooperation_trials import Mode
from uavmap.lab.localization_trials import Terms
from uavmap.ui.cli.common import number_type, pair

NONSTOP_DEFAULTS: Final[dict[str, Any]] = {
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
    """Add the options of strategies that do not stop."""
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


def refuse(
    options: argparse.Namespace, names: Iterable[str], error: type[UavmapError], why: str
) -> None:
    """Raise an error for the first of some options that is given."""
    for name in names:
        if getattr(options, name) is not None:
            raise error(f"--{name.replace('_', '-')} {why}")


# --- localization --------------------------------------------------------------------------------
TRIALS: Final = 100
CONFIDENCE: Final = 0.95
LOCALIZE_OPTIONS: Final = ("map", "noise", "slip", "confidence", "trials")
_REFUSED: Final = {
    "strategy": "a robot that localizes explores nothing",
    "speed": "localization counts moves",
    "drift": "localization is simulated on resting regions only",
    "comms": "a robot localizes alone",
    "animate": "there is no picture of a localization",
    "tree": "a localization has no tree",
    **dict.fromkeys(NONSTOP_DEFAULTS, "a robot that localizes moves from cell to cell"),
}


def add_localize_options(parser: argparse.ArgumentParser) -> None:
    """Add --localize and its options."""
    group = parser.add_argument_group(
        "--localize",
        "a robot that senses the eight neighbours of its cell finds out which cell of the ROI "
        "that is, in moves from cell to cell",
    )
    add = group.add_argument
    add(
        "--localize",
        metavar="METHOD",
        action="append",
        help=f"one or, with commas or given again, several of {', '.join(METHODS)}",
    )
    add(
        "--map",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="whether the robot has a map (default), or knows the width and height only",
    )
    add("--noise", metavar="FP,FN", help="how often an outside cell looks inside, and the reverse")
    slip = number_type(float, 0.0, 0.9)
    add("--slip", metavar="P", type=slip, help="how often a move stays, or goes elsewhere")
    add(
        "--confidence",
        metavar="P",
        type=number_type(float, 0.5, 0.9999),
        help=f"with --noise or --slip: how sure it has to be (default {CONFIDENCE})",
    )
    trials = number_type(int, 1, 1_000_000)
    add("--trials", metavar="N", type=trials, help=f"starts on each ROI (default {TRIALS})")


def methods_of(options: argparse.Namespace) -> list[Method]:
    """Return the chosen methods.

    Raises `LocalizationError` for an unknown one, or one that needs the map that --no-map denies.
    """
    names = [name for part in options.localize for name in part.split(",")]
    for name in names:
        if name not in METHODS:
            raise LocalizationError(
                f"--localize {name!r} is not known; choose one of {', '.join(METHODS)}"
            )
        if METHODS[name].needs_map and options.map is False:
            raise LocalizationError(f"--no-map: {name} needs a map; leave out one of the two")
    return [METHODS[name] for name in dict.fromkeys(names)]


def terms_of(options: argparse.Namespace) -> Terms:
    """Return the chosen terms. Raises `LocalizationError` for options that exclude each other."""
    _refuse_others(options)
    seed = 1 if options.seed is None else options.seed
    trials = TRIALS if options.trials is None else options.trials
    errors = _errors(options)
    if errors is not None and options.map is False:
        raise LocalizationError(
            "--no-map: who errs compares what it sees with a map; leave out --noise and --slip, "
            "or --no-map"
        )
    return Terms(options.map is not False, errors, trials, seed)


def _refuse_others(options: argparse.Namespace) -> None:
    for name, why in _REFUSED.items():
        if getattr(options, name) is not None:
            raise LocalizationError(f"--{name.replace('_', '-')} with --localize: {why}")
    if options.robots not in (None, 1):
        raise LocalizationError(
            f"--robots {options.robots} with --localize: a robot localizes alone; leave it out"
        )
    if options.index:
        raise LocalizationError("--index with --localize: there is no picture of a localization")
    if options.generate is not None and options.cell_m is not None:
        raise LocalizationError("--cell-m with --localize is for GeoJSON: moves have no length")


def _errors(options: argparse.Namespace) -> Errors | None:
    if options.noise is None and options.slip is None:
        if options.confidence is not None:
            raise LocalizationError(
                "--confidence is for --noise or --slip: who does not err ends when it is certain"
            )
        return None
    noise = EXACT
    if options.noise is not None:
        what = f"--noise {options.noise}"
        rates: tuple[Any, Any] = pair(what, options.noise, "FP,FN, such as 0.05,0.1")
        try:
            noise = Noise(*rates)
        except LocalizationError as error:
            raise LocalizationError(f"{what}: {error}") from None
    return Errors(noise, options.slip or 0.0, options.confidence or CONFIDENCE)


# --- robots that watch each other ----------------------------------------------------------------
MOST_TOGETHER: Final = 5
COOPERATION_OPTIONS: Final = ("cooperate", "range", "theta", "cover")
_OTHERS: Final = (
    "cells", "count", "cell_m", "strategy", "speed", "drift", "comms", "tree", "footprint", "accel",
    "frame_s", "error_rate", "loss_rate", "box_factor", "offline",
)  # fmt: skip
"""What an exploration of cells takes, and this one does not."""


def add_cooperation_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of --polygon."""
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


def checked_robots(options: argparse.Namespace) -> int:
    """Return the number of robots that explore a polygon together.

    Raises `StrategyError` for missing options, and for options that exclude each other.
    """
    for name, choose in (("cooperate", ", ".join(Mode)), ("range", "metres that a robot sees")):
        if getattr(options, name) is None:
            raise StrategyError(f"--polygon needs --{name}: {choose}")
    refuse(options, _OTHERS, StrategyError, "is for --roi and --generate, not --polygon")
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
