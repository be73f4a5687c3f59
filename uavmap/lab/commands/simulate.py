"""uavmap simulate: strategies on ROIs without noise, and a certificate of each run."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from missions.errors import (
    LinkError,
    LocalizationError,
    RoiError,
    StrategyError,
    UavmapError,
)
from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from missions.lab.arena.roi import KINDS, MAX_CELLS, Roi, grown
from missions.lab.strategies import EXPLORERS
from missions.planning.stepwise import Explorer
from missions.planning.stepwise.metric import Metric
from missions.planning.sweep.strategies import NONSTOP
from missions.units import LatLon
from uavmap.journal.results_folder import make_folder
from uavmap.lab.commands.runs import figures_by_name, free_file, run_all
from uavmap.lab.commands.simulate_options import (
    COOPERATION_OPTIONS,
    LOCALIZE_OPTIONS,
    NONSTOP_DEFAULTS,
    add_cooperation_options,
    add_localize_options,
    add_nonstop_options,
    refuse,
)
from uavmap.lab.roi_files import load_rois
from uavmap.lab.run_film import film_of_run
from uavmap.lab.simulated_links import draws, simulated_links
from uavmap.lab.trials import Terms, Trial, explored, means, trials
from uavmap.load.planner_setup import tell_if_uncompiled
from uavmap.ui.cli.common import number_type, pair, print_figures, seed_number
from uavmap.ui.cli.picture_options import (
    add_picture_options,
    check_pictures,
    wants_pictures,
    write_pictures,
)

MAX_ROBOTS: Final = 1000
_SUMMARY: Final = "summary.json"
_CELLS, _COUNT, _SEED = 120, 1, 1

EXAMPLES: Final = """\
examples:
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

A ROI file is JSON, {"rois": [{"start": [east, north], "cells": [[east, north], ...]}]}, or GeoJSON.
Times are in steps from cell to cell at unit speed; with --speed and --drift in the unit of time in
which V cells are flown. swath and survey do not stop over cells: their times are seconds, and
their speed and cells are in metres. wall_s (what the run took) and lower_bound_wall_s (what the
lower bound took, once for all strategies) alone are not the same from run to run.
"""
DESCRIPTION: Final = "Explore ROIs with perfect robots, and hold the makespan against its bounds."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add = parser.add_argument
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--roi", metavar="FILE", help="ROIs, or a growth KIND:CELLS:SEED")
    where.add_argument("--generate", metavar="KIND", help=f"grow ROIs: {', '.join(KINDS)}")
    where.add_argument(
        "--polygon",
        metavar="FILE",
        help="a polygon with holes, for --cooperate: GeoJSON, KML, or WKT or JSON in metres",
    )
    cells = number_type(int, 1, MAX_CELLS)
    count = number_type(int, 1, 100_000)
    add("--cells", metavar="N", type=cells, help=f"of a grown ROI (default {_CELLS})")
    add("--count", metavar="K", type=count, help=f"how many to grow (default {_COUNT})")
    add(
        "--seed",
        metavar="S",
        type=seed_number,
        help=f"of the first (default {_SEED}); then S + 1; of swath's errors; of a --comms loss",
    )
    cell_m = number_type(float, 0.01, 10_000.0)
    add(
        "--cell-m",
        metavar="M",
        type=cell_m,
        help="cell size for GeoJSON, swath and survey (default 4)",
    )
    add(
        "--start",
        metavar="LAT,LON",
        help="where to start, for GeoJSON: in the region, or at its rim (default: its west end); "
        "for --polygon (default: its southern corner; EAST,NORTH for a file in metres)",
    )
    add(
        "--strategy",
        metavar="NAME",
        action="append",
        help="one or, with commas or given again, several (default rdfs); see uavmap strategies",
    )
    add("--robots", metavar="R", type=number_type(int, 1, MAX_ROBOTS), help="default 1")
    speed = number_type(float, 1e-3, 1e3)
    add("--speed", metavar="V", type=speed, help="default 1; of swath and survey m/s, default 6")
    add("--drift", metavar="V,DEG", help="of the ROI: speed, and the bearing that it moves towards")
    add_comms_option(parser)
    add_nonstop_options(parser)
    add_localize_options(parser)
    add_cooperation_options(parser)
    add_picture_options(parser, several=True)
    add(
        "--out",
        metavar="DIR",
        help=f"write {_SUMMARY} into this folder, too; of a polygon also moves.csv, map.png",
    )
    add("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Simulate."""
    if options.localize is not None:
        if options.polygon is not None:
            raise StrategyError(
                "--localize is of one robot on a grid, --polygon of several in a polygon; leave "
                "out the one or the other"
            )
        refuse(options, COOPERATION_OPTIONS, StrategyError, "is for --polygon FILE")
        return _localize(options)
    refuse(options, LOCALIZE_OPTIONS, LocalizationError, "is for --localize METHOD")
    if options.polygon is not None:
        # its readers and pictures are nobody else's
        from uavmap.lab.commands.cooperation import run_cooperation  # noqa: PLC0415

        return run_cooperation(options)
    refuse(options, COOPERATION_OPTIONS, StrategyError, "is for --polygon FILE")
    options.robots = options.robots or 1
    names = _names(options.strategy)
    nonstop = [NONSTOP[name] for name in names if name in NONSTOP]
    if nonstop and len(nonstop) < len(names):
        raise StrategyError(
            f"--strategy: {', '.join(NONSTOP)} count in seconds, the others in steps; they cannot "
            "be compared in one table"
        )
    out = free_file(options.out, [_SUMMARY])
    check_pictures(options)
    if nonstop:
        # its kernels take a second to load
        from uavmap.lab.commands.nonstop import run_nonstop  # noqa: PLC0415

        rois = _rois(options, nonstop=True)
        return run_nonstop(options, rois, nonstop, out)
    others = f"is for --strategy {' or '.join(NONSTOP)}"
    refuse(options, NONSTOP_DEFAULTS, StrategyError, others)
    explorers = [EXPLORERS[name] for name in names]
    metric = _metric(options.speed or 1.0, options.drift)
    comms = comms_of(options, _SEED if options.seed is None else options.seed)
    radio = options.comms if isinstance(comms, Links) else None
    terms, team = Terms(options.robots, metric, comms), team_told(options.robots, radio)
    rois = _rois(options, seeded=draws(comms))
    if out is not None:
        make_folder(out.parent)  # before anything is computed
    tell_if_uncompiled((e.name for e in explorers), lambda text: print(text, file=sys.stderr))
    done, code = run_all(trials(rois, explorers, terms), len(rois) * len(explorers))
    if not print_figures(_figures(done, explorers, radio), out, as_json=options.json):
        _table(done, explorers, team)
    if wants_pictures(options) and code == 0:
        _pictures(options, rois[options.index], explorers[0], terms, team)
    return code


def _localize(options: argparse.Namespace) -> int:
    """Robots that do not know where they are."""
    from uavmap.lab.commands.localize import run_localize  # noqa: PLC0415 - not for the others

    return run_localize(
        options, lambda: _rois(options, nonstop=True), free_file(options.out, [_SUMMARY])
    )


def _pictures(
    options: argparse.Namespace, roi: Roi, explorer: Explorer, terms: Terms, team: str
) -> None:
    """One run again, to be looked at."""
    shown = explored(roi, explorer, terms)
    film = film_of_run(shown, roi.cells, f"{roi.name}   ·   {explorer.name}, {team}")
    write_pictures(options, film, shown.tree, lambda text: print(text, file=sys.stderr))


def _names(wanted: Sequence[str] | None) -> list[str]:
    names = [name for part in wanted or ["rdfs"] for name in part.split(",")]
    for name in names:
        if name not in EXPLORERS and name not in NONSTOP:
            known = ", ".join([*EXPLORERS, *NONSTOP])
            raise StrategyError(f"--strategy {name!r} is not known; choose one of {known}")
    return list(dict.fromkeys(names))


def _metric(speed: float, drift: str | None) -> Metric:
    toward, drift_speed = 0.0, 0.0
    if drift is not None:
        drift_speed, toward = pair(f"--drift {drift}", drift, "V,DEG, such as 0.4,90")
    if not 0.0 <= drift_speed < speed:
        raise UavmapError(f"--drift {drift}: robots of speed {speed:g} do not keep up with it")
    bearing = math.radians(toward)
    return Metric(speed, drift_speed * math.sin(bearing), drift_speed * math.cos(bearing))


def _rois(options: argparse.Namespace, *, nonstop: bool = False, seeded: bool = False) -> list[Roi]:
    found = _read_or_grown(options, nonstop=nonstop, seeded=nonstop or seeded)
    if options.index >= len(found):
        raise RoiError(f"--index {options.index}: there are {len(found)} ROIs, counted from 0")
    return found


def _read_or_grown(options: argparse.Namespace, *, nonstop: bool, seeded: bool) -> list[Roi]:
    if options.generate is not None:
        geojson = ("start",) if nonstop else ("cell_m", "start")
        refuse(options, geojson, RoiError, "is for --roi with GeoJSON")
        seed = _SEED if options.seed is None else options.seed
        cells = options.cells or _CELLS
        return [grown(options.generate, cells, seed + i) for i in range(options.count or _COUNT)]
    refuse(options, ("cells", "count"), RoiError, "is for --generate")
    if not seeded:
        refuse(options, ("seed",), RoiError, "is for --generate, or for --comms with a loss")
    start = None
    if options.start is not None:
        start = LatLon(*pair(f"--start {options.start}", options.start, "LAT,LON in degrees"))
    return load_rois(options.roi, cell_m=options.cell_m or 4.0, start=start)


def _figures(
    done: Sequence[Trial], explorers: Sequence[Explorer], comms: str | None
) -> dict[str, Any]:
    """The figures of one strategy, or of several by name; with the radio where there is one."""
    told = {} if comms is None else {"comms": comms}
    return figures_by_name({e.name: _of(e, done) for e in explorers}, means, told)


def _of(explorer: Explorer, done: Sequence[Trial]) -> list[Trial]:
    return [trial for trial in done if trial.strategy == explorer.name]


def _table(done: Sequence[Trial], explorers: Sequence[Explorer], team: str) -> None:
    """The certificates for people: of a ROI, or the means of several."""
    runs = len(done) // len(explorers)
    table = Table(
        title=f"{done[0].roi if runs == 1 else f'means of {runs} ROIs'}, {team}" if done else "",
        title_justify="left",
    )
    table.add_column("strategy", no_wrap=True)
    for title in ("T", "LB", "T / LB", "bound", "held", "depth", "moves", "s"):
        table.add_column(title, justify="right")
    for explorer in explorers:
        mean = means(_of(explorer, done))
        if mean:
            table.add_row(
                explorer.name,
                f"{mean['makespan']:.1f}",
                f"{mean['lower_bound']:.1f}",
                "" if mean["ratio"] is None else f"{mean['ratio']:.3f}",
                "none" if mean["bound"] is None else f"{mean['bound']:.1f}",
                {True: "yes", False: "NO", None: ""}[mean["bound_held"]],
                f"{mean['tree_depth']:.1f}",
                f"{mean['moves']:.1f}",
                f"{mean['wall_s']:.3f}",
            )
    Console().print(table)
    print("T makespan, LB lower bound for any strategy, bound what the strategy promises")
    if done:
        mean_s = means(done)["lower_bound_wall_s"]
        print(f"s real time of a run; the lower bound of a ROI took another {mean_s:.3f} s")


# --- the radio -----------------------------------------------------------------------------------
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
