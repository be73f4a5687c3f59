"""Options of uavmap simulate for certain strategies.

These do not stop over cells, localize, or watch each other. The parser has no defaults for them: so
it is known which were given.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
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

Add = Callable[..., None]


def value_options(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> Add:
    """Return a function that adds an option with a value: flag, metavar, help, conversion."""

    def add(flag: str, metavar: str | None, text: str, kind: Any = None, **more: Any) -> None:
        parser.add_argument(flag, metavar=metavar, help=text, type=kind, **more)

    return add


def add_nonstop_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of strategies that do not stop."""
    group = parser.add_argument_group(
        f"{' and '.join(NONSTOP)}",
        "flight without stopping, in seconds and metres, from the start cell back to it",
    )
    add, rate = value_options(group), number_type(float, 0.0, 0.4)
    add("--footprint", "M[,M]", "what a frame shows, m east and north (default 15)")
    add("--accel", "A", "acceleration, m/s^2 (default 2.5)", number_type(float, 0.1, 20.0))
    add("--frame-s", "S", "from frame to frame (default 0.2)", number_type(float, 0.02, 10.0))
    add("--error-rate", "P", "of votes that are wrong (default 0)", rate)
    add("--loss-rate", "P", "of frames that are lost (default 0)", rate)
    box = "box of a survey: F times as wide as the region (default: 2 cells beyond it)"
    add("--box-factor", "F", box, number_type(float, 1.0, 20.0))
    offline = "a reference that knows the region"
    group.add_argument("--offline", action="store_true", default=None, help=offline)


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
    add = value_options(group)
    methods = f"one or, with commas or given again, several of {', '.join(METHODS)}"
    add("--localize", "METHOD", methods, action="append")
    with_map = "whether the robot has a map (default), or knows the width and height only"
    group.add_argument("--map", action=argparse.BooleanOptionalAction, default=None, help=with_map)
    add("--noise", "FP,FN", "how often an outside cell looks inside, and the reverse")
    add("--slip", "P", "how often a move stays, or goes elsewhere", number_type(float, 0.0, 0.9))
    sure = f"with --noise or --slip: how sure it has to be (default {CONFIDENCE})"
    add("--confidence", "P", sure, number_type(float, 0.5, 0.9999))
    trials = number_type(int, 1, 1_000_000)
    add("--trials", "N", f"starts on each ROI (default {TRIALS})", trials)


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
    *("cells", "count", "cell_m", "strategy", "speed", "drift", "comms", "tree"),
    *NONSTOP_DEFAULTS,
)
"""Options of an exploration of cells, not of a polygon."""


def add_cooperation_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of --polygon."""
    group = parser.add_argument_group(
        "robots that watch each other",
        "with --polygon: one moves while others see it; path, exchanges, map, errors of place",
    )
    add, modes, covers = value_options(group), [m.value for m in Mode], [c.value for c in Cover]
    add("--cooperate", None, "how the polygon is explored", choices=modes)
    add("--range", "M", "how far a robot sees, metres", number_type(float, 0.01, 1e5))
    theta = "what a move takes up for who watches it, 1 to 170 degrees (default 60)"
    add("--theta", "DEG", theta, number_type(float, 1.0, 170.0))
    add("--cover", None, "of trapezoid: what a move covers (default triangles)", choices=covers)


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
