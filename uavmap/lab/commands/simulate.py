"""uavmap simulate: strategies on ROIs without noise, and a certificate of each run."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from missions.errors import LinkError, LocalizationError, RoiError, StrategyError
from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from missions.lab.arena.roi import KINDS, MAX_CELLS, Roi, grown
from missions.lab.cooperation.trapezoids import Cover
from missions.lab.strategies import EXPLORERS
from missions.planning.stepwise import Explorer
from missions.planning.stepwise.interface import Metric
from missions.planning.sweep.strategies import NONSTOP
from missions.units import LatLon
from uavmap.lab.commands.localize import LOCALIZE_OPTIONS, add_localize_options, run_localize
from uavmap.lab.commands.runs import (
    NONSTOP_DEFAULTS,
    Column,
    Outcome,
    free_file,
    print_line,
    print_means,
    refuse,
    run_trials,
    value_options,
)
from uavmap.lab.cooperation_trials import Mode
from uavmap.lab.roi_files import load_rois
from uavmap.lab.run_film import film_of_run
from uavmap.lab.simulating import (
    MAX_ROBOTS,
    draws,
    known_strategies,
    metric_of,
    nonstop_among,
    simulated_links,
)
from uavmap.lab.trials import Terms, explored, means, trials
from uavmap.load.strategy_source import warn_if_uncompiled
from uavmap.ui.cli.commands.animate import (
    add_picture_options,
    check_pictures,
    wants_pictures,
    write_pictures,
)
from uavmap.ui.cli.common import number_type, pair, seed_number

_COMMS_HELP: Final = (
    "knowledge of the others' observations: shared (or free), all at once (default); meeting, "
    "only at one vertex; or a radio, range:CELLS. After range:CELLS or shared, with commas: "
    "loss:SHARE, delay:TIME, rate:CELLS_A_UNIT_OF_TIME, apart:BEGIN-END (no contact "
    "then; apart:10-30:1+2/3+4: contact only within one group)"
)
COOPERATION_OPTIONS: Final = ("cooperate", "range", "theta", "cover")
_SUMMARY: Final = "summary.json"
_CELLS, _COUNT, _SEED = 120, 1, 1

EXAMPLES: Final = """\
  uavmap simulate --generate eden --cells 120 --count 10 --robots 4
  uavmap simulate --roi rois.json --strategy rdfs,rdfs-paper --robots 8 --json
  uavmap simulate --roi lake.geojson --cell-m 10 --start 46.7,-92.0 --robots 3
  uavmap simulate --roi eden:120:7 --drift 0.4,90 --speed 1 --comms meeting
  uavmap simulate --generate eden --count 10 --robots 4 --comms range:8,loss:0.2
  uavmap simulate --roi eden:300:2 --robots 5 --animate five.gif --tree five.svg

  uavmap simulate --generate ragged --strategy swath,survey --robots 3 --footprint 20,15
  uavmap simulate --generate eden --count 10 --localize homing,plan
  uavmap simulate --roi eden:120:7 --localize plan --noise 0.056,0.11 --slip 0.02 --trials 1000

  uavmap simulate --polygon examples/hall.wkt --cooperate trapezoid --range 10 --out watched
  uavmap simulate --polygon field.kml --cooperate column --robots 5 --range 40 --json
"""
NOTES: Final = """\
A ROI file is JSON, {"rois": [{"start": [east, north], "cells": [[east, north], ...]}]}, or GeoJSON.
Times are in steps from cell to cell at unit speed. With --speed and --drift, the unit of time is
that in which a robot flies V cells. The strategies swath and survey do not stop over cells: their
times are in seconds, and their speed and cells in metres.

Only wall_s (time of the run) and lower_bound_wall_s (time of the lower bound, once for all
strategies) differ from run to run.
"""
DESCRIPTION: Final = "Explore ROIs with perfect robots, and compare the makespan with its bounds."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    where = parser.add_mutually_exclusive_group(required=True)
    source = value_options(where)
    source("--roi", "FILE", "ROIs, or a growth KIND:CELLS:SEED")
    source("--generate", "KIND", f"grow ROIs: {', '.join(KINDS)}")
    polygon = "a polygon with holes, for --cooperate: GeoJSON, KML, or WKT or JSON in metres"
    source("--polygon", "FILE", polygon)
    add = value_options(parser)
    add("--cells", "N", f"of a grown ROI (default {_CELLS})", number_type(int, 1, MAX_CELLS))
    add("--count", "K", f"number of ROIs to grow (default {_COUNT})", number_type(int, 1, 100_000))
    seed = f"of the first (default {_SEED}); then S + 1; of swath's errors; of a --comms loss"
    add("--seed", "S", seed, seed_number)
    cell_m = "cell size for GeoJSON, swath and survey (default 4)"
    add("--cell-m", "M", cell_m, number_type(float, 0.01, 10_000.0))
    add(
        "--start",
        "LAT,LON",
        "start, for GeoJSON in the region or at its rim (default: its west end). With --polygon "
        "default: the southern corner; EAST,NORTH for a file in metres",
    )
    names = "one or, with commas or given again, several (default rdfs); see uavmap strategies"
    add("--strategy", "NAME", names, action="append")
    add("--robots", "R", "default 1", number_type(int, 1, MAX_ROBOTS))
    speed = "default 1; of swath and survey m/s, default 6"
    add("--speed", "V", speed, number_type(float, 1e-3, 1e3))
    add("--drift", "V,DEG", "of the ROI: speed, and the bearing that it moves towards")
    add("--comms", "HOW", _COMMS_HELP)
    _add_nonstop_options(parser)
    add_localize_options(parser)
    _add_cooperation_options(parser)
    add_picture_options(parser, several=True)
    out = f"write {_SUMMARY} into this folder; of a polygon also moves.csv, map.png"
    add("--out", "DIR", out)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def _add_nonstop_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of strategies that do not stop."""
    group = parser.add_argument_group(
        f"{' and '.join(NONSTOP)}",
        "flight without stopping, in seconds and metres, from the start cell back to it",
    )
    add, rate = value_options(group), number_type(float, 0.0, 0.4)
    add("--footprint", "M[,M]", "ground in a frame, m east and north (default 15)")
    add("--accel", "A", "acceleration, m/s^2 (default 2.5)", number_type(float, 0.1, 20.0))
    add("--frame-s", "S", "from frame to frame (default 0.2)", number_type(float, 0.02, 10.0))
    add("--error-rate", "P", "of votes that are wrong (default 0)", rate)
    add("--loss-rate", "P", "of frames that are lost (default 0)", rate)
    box = "box of a survey: F times as wide as the region (default: 2 cells beyond it)"
    add("--box-factor", "F", box, number_type(float, 1.0, 20.0))
    offline = "a reference that knows the region"
    group.add_argument("--offline", action="store_true", default=None, help=offline)


def _add_cooperation_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of --polygon."""
    group = parser.add_argument_group(
        "robots that watch each other",
        "with --polygon: one moves while others see it; path, exchanges, map, errors of place",
    )
    add, modes, covers = value_options(group), [m.value for m in Mode], [c.value for c in Cover]
    add("--cooperate", None, "mode of the exploration of the polygon", choices=modes)
    add("--range", "M", "range of a robot's sight, metres", number_type(float, 0.01, 1e5))
    theta = "angle of a move for its observer, 1 to 170 degrees (default 60)"
    add("--theta", "DEG", theta, number_type(float, 1.0, 170.0))
    add("--cover", None, "of trapezoid: area of a move (default triangles)", choices=covers)


def run(options: argparse.Namespace) -> int:
    """Run the simulation."""
    if options.localize is not None:
        if options.polygon is not None:
            raise StrategyError(
                "--localize is of one robot on a grid, --polygon of several in a polygon; leave "
                "out the one or the other"
            )
        refuse(options, COOPERATION_OPTIONS, StrategyError, "is for --polygon FILE")
        out = free_file(options.out, [_SUMMARY])
        return run_localize(options, lambda: _rois(options, nonstop=True), out)
    refuse(options, LOCALIZE_OPTIONS, LocalizationError, "is for --localize METHOD")
    if options.polygon is not None:
        from uavmap.lab.commands.cooperation import run_cooperation  # noqa: PLC0415 - reads areas of all kinds

        return run_cooperation(options)
    refuse(options, COOPERATION_OPTIONS, StrategyError, "is for --polygon FILE")
    options.robots = options.robots or 1
    names = [name for part in options.strategy or ["rdfs"] for name in part.split(",")]
    names = known_strategies(names, "--strategy ")
    nonstop = nonstop_among(names, "--strategy")
    out = free_file(options.out, [_SUMMARY])
    check_pictures(options)
    if nonstop:
        from uavmap.lab.commands.nonstop import run_nonstop  # noqa: PLC0415 - loads its kernels

        rois = _rois(options, nonstop=True)
        return run_nonstop(options, rois, [NONSTOP[name] for name in nonstop], out)
    others = f"is for --strategy {' or '.join(NONSTOP)}"
    refuse(options, NONSTOP_DEFAULTS, StrategyError, others)
    return _run_stepwise(options, [EXPLORERS[name] for name in names], out)


def _run_stepwise(
    options: argparse.Namespace, explorers: Sequence[Explorer], out: Path | None
) -> int:
    metric, comms = _metric(options.speed or 1.0, options.drift), _comms(options)
    terms, team = Terms(options.robots, metric, comms), f"{options.robots} robot"
    team += "s" * (options.robots > 1)
    radio = {"comms": options.comms} if isinstance(comms, Links) else {}
    team = ", ".join([team, *radio.values()])
    rois, names = _rois(options, seeded=draws(comms)), [e.name for e in explorers]
    warn_if_uncompiled(names, print_line)
    runs = trials(rois, explorers, terms)
    outcome = run_trials(runs, len(rois), names, means, out, as_json=options.json, more=radio)
    if not outcome.printed:
        _print_tables(outcome, team)
    if wants_pictures(options) and outcome.code == 0:
        roi, explorer = rois[options.index], explorers[0]
        shown = explored(roi, explorer, terms)
        film = film_of_run(shown, roi.cells, f"{roi.name}   ·   {explorer.name}, {team}")
        write_pictures(options, film, shown.tree, print_line)
    return outcome.code


def _comms(options: argparse.Namespace) -> Comms | Links:
    if options.comms is None:
        return Comms.SHARED
    try:
        return simulated_links(options.comms, options.robots, _seed(options))
    except ValueError as error:
        raise LinkError(f"--comms {options.comms}: {error}") from None


def _seed(options: argparse.Namespace) -> int:
    return _SEED if options.seed is None else int(options.seed)


def _metric(speed: float, drift: str | None) -> Metric:
    toward, drift_speed = 0.0, 0.0
    if drift is not None:
        drift_speed, toward = pair(f"--drift {drift}", drift, "V,DEG, such as 0.4,90")
    return metric_of(speed, drift_speed, toward, f"--drift {drift}")


def _rois(options: argparse.Namespace, *, nonstop: bool = False, seeded: bool = False) -> list[Roi]:
    """Read or grow the ROIs; `seeded`: the seed serves for more than growing."""
    if options.generate is not None:
        geojson = ("start",) if nonstop else ("cell_m", "start")
        refuse(options, geojson, RoiError, "is for --roi with GeoJSON")
        kind, cells, seed = options.generate, options.cells or _CELLS, _seed(options)
        found = [grown(kind, cells, seed + i) for i in range(options.count or _COUNT)]
    else:
        refuse(options, ("cells", "count"), RoiError, "is for --generate")
        if not (nonstop or seeded):
            refuse(options, ("seed",), RoiError, "is for --generate, or for --comms with a loss")
        start = None
        if options.start is not None:
            start = LatLon(*pair(f"--start {options.start}", options.start, "LAT,LON in degrees"))
        found = load_rois(options.roi, cell_m=options.cell_m or 4.0, start=start)
    if options.index >= len(found):
        raise RoiError(f"--index {options.index}: there are {len(found)} ROIs, counted from 0")
    return found


_COLUMNS: Final = {
    "T": Column("makespan", ".1f"),
    "LB": Column("lower_bound", ".1f"),
    "T / LB": Column("ratio", ".3f"),
    "bound": Column("bound", ".1f", "none"),
    "held": Column("bound_held"),
    "depth": Column("tree_depth", ".1f"),
    "moves": Column("moves", ".1f"),
    "s": Column("wall_s", ".3f"),
}


def _print_tables(outcome: Outcome, team: str) -> None:
    title = f"{outcome.title}, {team}" if outcome.done else ""
    print_means(title, _COLUMNS, outcome.means, ("strategy",))
    print("T makespan, LB lower bound for any strategy, bound of the strategy")
    if outcome.done:
        mean_s = means([trial.figures for trial in outcome.done])["lower_bound_wall_s"]
        print(f"s real time of a run; the lower bound of a ROI took another {mean_s:.3f} s")
