"""Options of uavmap simulate for robots that do not know where they are."""

from __future__ import annotations

import argparse
from typing import Any, Final

from missions.errors import LocalizationError
from missions.lab.localization.methods import METHODS, Method
from missions.lab.localization.noisy_run import Errors
from missions.lab.localization.pose_belief import EXACT, Noise
from uavmap.lab.commands.nonstop_options import DEFAULTS as NONSTOP_OPTIONS
from uavmap.lab.localization_trials import Terms
from uavmap.ui.cli.common import number_type, pair

TRIALS: Final = 100
CONFIDENCE: Final = 0.95
_OWN: Final = ("map", "noise", "slip", "confidence", "trials")
_REFUSED: Final = {
    "strategy": "a robot that localizes explores nothing",
    "speed": "localization counts moves",
    "drift": "localization is simulated on resting regions only",
    "comms": "a robot localizes alone",
    "animate": "there is no picture of a localization",
    "tree": "a localization has no tree",
    **dict.fromkeys(NONSTOP_OPTIONS, "a robot that localizes moves from cell to cell"),
}


def add_localize_options(parser: argparse.ArgumentParser) -> None:
    """Add --localize and what belongs to it; none has a default here, so that it is known which
    were given."""
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


def refuse_localize_options(options: argparse.Namespace) -> None:
    """Raise `LocalizationError` where one of them is given without --localize."""
    for name in _OWN:
        if getattr(options, name) is not None:
            raise LocalizationError(f"--{name} is for --localize METHOD")


def methods_of(options: argparse.Namespace) -> list[Method]:
    """The methods that were asked for.

    Raises:
        LocalizationError: one that is not known, or that needs the map that --no-map takes away.
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
    """The terms that were asked for.

    Raises:
        LocalizationError: options that do not go together, or rates that are none.
    """
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
