"""uavmap simulate for strategies that do not stop over cells: runs and tables in seconds."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from missions.errors import StrategyError, UavmapError
from missions.lab.arena.nonstop import Camera, Team
from missions.lab.arena.roi import Roi
from missions.planning.sweep.strategies import StrategyInfo
from uavmap.lab.commands.runs import (
    NONSTOP_DEFAULTS,
    Column,
    Outcome,
    print_line,
    print_means,
    run_trials,
)
from uavmap.lab.nonstop_trials import FlightTerms, fly_strategy, nonstop_means, nonstop_trials
from uavmap.lab.run_film import film_of_nonstop
from uavmap.load.strategy_source import warn_if_uncompiled
from uavmap.ui.cli.commands.animate import wants_pictures, write_pictures
from uavmap.ui.cli.common import pair

_SPEED_M_S: Final = 6.0
_CELL_M: Final = 4.0


def run_nonstop(
    options: argparse.Namespace,
    rois: Sequence[Roi],
    strategies: Sequence[StrategyInfo],
    out: Path | None,
) -> int:
    """Simulate flight without stopping; return the exit code."""
    terms, names = _terms(options), [strategy.name for strategy in strategies]
    warn_if_uncompiled(names, print_line)
    outcome = run_trials(
        nonstop_trials(rois, strategies, terms), len(rois), names, nonstop_means, out,
        as_json=options.json,
    )  # fmt: skip
    if not outcome.printed:
        _print_tables(outcome, terms)
    if wants_pictures(options) and outcome.code == 0:
        roi, strategy, team = rois[options.index], strategies[0], terms.team
        shown = fly_strategy(roi, strategy, terms, record=True)
        title = f"{roi.name}   ·   {strategy.name}, {_vehicles(terms)}"
        shows_m = (team.camera.east_m, team.camera.north_m)
        film = film_of_nonstop(shown, roi, team.cell_m, shows_m, title)
        write_pictures(options, film, None, print_line)
    return outcome.code


def _terms(options: argparse.Namespace) -> FlightTerms:
    """Read the options. Raises `UavmapError` for one that does not apply, or a bad footprint."""
    for name, why in (
        ("drift", "these strategies are simulated on resting regions only"),
        (
            "comms",
            "these vehicles always share what they know; with a radio between them they are flown: "
            "uavmap fly MISSION --sim --comms HOW",
        ),
        ("tree", "these strategies have no tree"),
    ):
        if getattr(options, name) is not None:
            raise StrategyError(f"--{name}: {why}")
    given = {name: getattr(options, name) for name in NONSTOP_DEFAULTS}
    value = {name: NONSTOP_DEFAULTS[name] if v is None else v for name, v in given.items()}
    text = value["footprint"]
    both = text if "," in text else f"{text},{text}"
    east_m, north_m = pair(f"--footprint {text}", both, "metres, such as 15 or 20,15")
    if not (0.0 < east_m <= 1000.0 and 0.0 < north_m <= 1000.0):
        raise UavmapError(f"--footprint {text} is not between 0 and 1000")
    camera = Camera(
        east_m, north_m, value["frame_s"], error_rate=value["error_rate"],
        loss_rate=value["loss_rate"],
    )  # fmt: skip
    cell_m, speed_m_s = options.cell_m or _CELL_M, options.speed or _SPEED_M_S
    team = Team(options.robots, camera, cell_m, speed_m_s, value["accel"])
    seed = 1 if options.seed is None else options.seed  # of the errors, and of the search for plans
    return FlightTerms(team, value["box_factor"], offline=value["offline"], seed=seed)


_COLUMNS: Final = {
    "T, s": Column("makespan_s", ".1f"),
    "LB, s": Column("lower_bound_s", ".1f"),
    "T / LB": Column("ratio", ".2f"),
}
_OFFLINE: Final = {
    "offline, s": Column("offline_s", ".2f"),
    "T / offline": Column("ratio_offline", ".2f"),
}
_LAST: Final = {
    "missed": Column("cells_missed", "g"),
    "wrong": Column("cells_wrong", "g"),
    "s": Column("wall_s", ".3f"),
}


def _print_tables(outcome: Outcome, terms: FlightTerms) -> None:
    title = f"{outcome.title}, {_vehicles(terms)}" if outcome.done else ""
    columns = _COLUMNS | (_OFFLINE if terms.offline else {}) | _LAST
    print_means(title, columns, outcome.means, ("strategy",))
    print("T makespan, LB lower bound for any strategy, s real time of a run; without take-off")
    print("and search: from the start cell until everything is decided and all are back")
    if terms.offline:
        print("offline: the best way found with a known region; not proven to be the best")


def _vehicles(terms: FlightTerms) -> str:
    return f"{terms.team.robots} vehicle" + "s" * (terms.team.robots > 1)
