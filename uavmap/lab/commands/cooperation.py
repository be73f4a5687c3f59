"""uavmap simulate for robots that watch each other: runs, tables and pictures."""

from __future__ import annotations

import argparse
import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from missions.errors import AreaError, StrategyError
from missions.lab.cooperation.space import Point
from missions.lab.cooperation.trapezoids import Cover
from missions.units import LatLon
from uavmap.journal.results_folder import make_folder
from uavmap.lab.commands.runs import free_file, print_table, tell
from uavmap.lab.commands.simulate_options import checked_robots
from uavmap.lab.cooperation_film import write_animation, write_picture
from uavmap.lab.cooperation_trials import Cooperation, Mode, Report, cooperate
from uavmap.lab.polygon_file import Ground, read_polygon_file
from uavmap.output.film.film_writers import FILMS, check_path, save
from uavmap.ui.cli import INCOMPLETE, INTERRUPTED
from uavmap.ui.cli.common import pair, print_figures

FILES: Final = ("summary.json", "moves.csv", "map.png")
_THETA_DEG: Final = 60.0


def run_cooperation(options: argparse.Namespace) -> int:
    """Simulate; return the exit code."""
    terms = Cooperation(
        mode=Mode(options.cooperate or Mode.TRAPEZOID),
        robots=checked_robots(options),
        range_m=options.range,
        theta_rad=math.radians(_THETA_DEG if options.theta is None else options.theta),
        cover=Cover(options.cover or Cover.TRIANGLES),
        seed=1 if options.seed is None else options.seed,
    )
    summary = free_file(options.out, FILES)
    out = None if summary is None else summary.parent
    if options.animate is not None:
        check_path(options.animate, FILMS)
    ground = read_polygon_file(options.polygon)
    start = _start(options.start, ground)
    if out is not None:
        make_folder(out)  # before anything is computed
    try:
        report = cooperate(ground.space, terms, start)
    except (AreaError, StrategyError) as error:
        raise type(error)(f"{options.polygon}: {error}") from None
    except KeyboardInterrupt:
        tell("uavmap: interrupted")
        return INTERRUPTED
    if not print_figures(report.figures(), summary, as_json=options.json):
        _print_tables(report, Path(options.polygon).name)
    if out is not None:
        save(out / FILES[1], moves_csv(report).encode())
        write_picture(report, out / FILES[2])
        tell(f"results in {out}")
    if options.animate is not None:
        write_animation(report, options.animate)
        tell(f"animation in {options.animate}")
    return 0 if report.complete else INCOMPLETE


def _start(text: str | None, ground: Ground) -> Point | None:
    if text is None:
        return None
    if ground.plane is None:
        return pair(f"--start {text}", text, "EAST,NORTH in metres, as the file has them")
    lat_deg, lon_deg = pair(f"--start {text}", text, "LAT,LON in degrees")
    return ground.plane.to_plane(LatLon(lat_deg, lon_deg))


def moves_csv(report: Report) -> str:
    """Write the moves: a line for each end of a leg, and for its beginning."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("move", "robot", "for", "east_m", "north_m"))
    for number, move in enumerate(report.exploration.moves, 1):
        for east, north in move.path:
            row = (number, move.robot + 1, move.why.value, f"{east:.4f}", f"{north:.4f}")
            writer.writerow(row)
    return text.getvalue()


def _print_tables(report: Report, name: str) -> None:
    figures, terms = report.figures(), report.terms
    pieces = "triangles" if terms.mode is Mode.TRIANGULATION else "stripes"
    rows = (
        ("path of all robots, m", f"{figures['path_m']:.1f}"),
        ("of it through known ground, m", f"{figures['known_path_m']:.1f}"),
        ("exchanges (steps)", str(figures["steps"])),
        ("turns, as the paper counts", str(figures["turns"])),
        ("changes of course", str(figures["corners"])),
        (pieces, str(figures["pieces"])),
        ("area mapped, sq m", f"{figures['mapped_m2']:.1f}"),
        ("area missed, sq m", f"{figures['missed_m2']:.1f}"),
        ("points seen by no robot", f"{figures['points_unseen']} of {figures['points_looked_at']}"),
    )
    print_table(f"{name}, {terms.robots} robots, {terms.mode}", ("figure", "value"), rows)
    columns = ("robot", "error, m", "ellipse, m", "alone: error, m", "alone: ellipse, m")
    ends = [
        (str(end["robot"]), *_error_texts(end["watched"]), *_error_texts(end["alone"]))
        for end in figures["final_places"]
    ]
    print_table("where robots are in the end, one sigma", columns, ends, left=0)
    print("alone: the same odometers, and nobody watching")


def _error_texts(end: Mapping[str, float]) -> tuple[str, str]:
    size = f"{end['ellipse_major_m']:.2f} x {end['ellipse_minor_m']:.2f}"
    return f"{end['error_m']:.2f}", size
