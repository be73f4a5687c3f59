"""uavmap simulate for robots that watch each other: runs, tables and pictures."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import shapely
from shapely.errors import ShapelyError
from shapely.geometry import Polygon

from missions.errors import AreaError, StrategyError
from missions.geo.geodesy import LocalPlane
from missions.lab.cooperation.space import Point, Space
from missions.lab.cooperation.trapezoids import Cover
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.base.text_files import read_text
from uavmap.journal.results_folder import make_folder
from uavmap.lab.commands.runs import NONSTOP_DEFAULTS, free_file, print_line, print_table, refuse
from uavmap.lab.cooperation_trials import (
    Cooperation,
    Mode,
    Report,
    cooperate,
    write_animation,
    write_picture,
)
from uavmap.load.areas.drawing import Positions
from uavmap.load.areas.reading import read_area_file
from uavmap.output.documents import save
from uavmap.output.film.film_writers import FILMS, check_path
from uavmap.ui.cli import INCOMPLETE, INTERRUPTED
from uavmap.ui.cli.common import pair, print_figures

FILES: Final = ("summary.json", "moves.csv", "map.png")
_THETA_DEG: Final = 60.0

MAX_TOGETHER: Final = 5
_OTHERS: Final = (
    *("cells", "count", "cell_m", "strategy", "speed", "drift", "comms", "tree"),
    *NONSTOP_DEFAULTS,
)
"""Options of an exploration of cells, not of a polygon."""


def run_cooperation(options: argparse.Namespace) -> int:
    """Simulate robots that watch each other; return the exit code."""
    terms = Cooperation(
        mode=Mode(options.cooperate or Mode.TRAPEZOID),
        robots=_checked_robots(options),
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
        print_line("uavmap: interrupted")
        return INTERRUPTED
    if not print_figures(report.figures(), summary, as_json=options.json):
        _print_tables(report, Path(options.polygon).name)
    if out is not None:
        save(out / FILES[1], moves_csv(report).encode())
        write_picture(report, out / FILES[2])
        print_line(f"results in {out}")
    if options.animate is not None:
        write_animation(report, options.animate)
        print_line(f"animation in {options.animate}")
    return 0 if report.complete else INCOMPLETE


def _checked_robots(options: argparse.Namespace) -> int:
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
    few, most = (3, MAX_TOGETHER) if mode is Mode.COLUMN else (2, 2)
    robots = int(few if options.robots is None else options.robots)
    if not few <= robots <= most:
        remedy = {Mode.COLUMN: "two are for --cooperate trapezoid"}
        raise StrategyError(
            f"--robots {robots}: {mode} takes {few if few == most else f'{few} to {most}'}; "
            + remedy.get(mode, f"three to {MAX_TOGETHER} are for --cooperate column")
        )
    return robots


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
    print_table("final places of the robots, one sigma", columns, ends, left=0)
    print("alone: the same odometers, without an observer")


def _error_texts(end: Mapping[str, float]) -> tuple[str, str]:
    size = f"{end['ellipse_major_m']:.2f} x {end['ellipse_minor_m']:.2f}"
    return f"{end['error_m']:.2f}", size


# --- a polygon in metres, from a file -------------------------------------------------------------
_MAX_BYTES: Final = 2_000_000


@dataclass(frozen=True, slots=True)
class Ground:
    """A ground to explore."""

    space: Space
    plane: LocalPlane | None
    """Origin of its metres on the earth; None for a file in metres."""


def read_polygon_file(name: str) -> Ground:
    """Read the polygon of a file. Raises `AreaError` with the file, the fault and the remedy.

    * WKT in metres: `POLYGON ((0 0, 40 0, 40 20, 0 0), (20 4, 30 4, 30 8, 20 4))`.
    * JSON in metres: `{"polygon_m": [[0, 0], [40, 0], [40, 20]], "holes_m": [[[5, 2], ...]]}`.
    * GeoJSON, KML and the others of `uavmap.load.areas.reading`: one area, in metres true east and
      true north of its south-western corner. A keep-out zone is a hole.
    """
    try:
        text = read_text(Path(name), _MAX_BYTES).lstrip("\ufeff \t\r\n")
    except (OSError, ValueError):
        text = ""  # the readers of areas report what is no text
    try:
        if text[:7].casefold() == "polygon":
            return Ground(_from_wkt(text), None)
        if text.startswith("{") and '"polygon_m"' in text:
            return Ground(_from_json(text), None)
        return _from_area(name)
    except AreaError as error:
        reason = str(error)
        raise AreaError(reason if reason.startswith(name) else f"{name}: {reason}") from None


def _from_wkt(text: str) -> Space:
    try:
        polygon = shapely.from_wkt(text)
    except ShapelyError as error:
        raise AreaError(
            f"not WKT ({printable(str(error), 80)}); give POLYGON ((x y, ...), ...), each "
            "ring ending where it begins"
        ) from None
    if not isinstance(polygon, Polygon) or polygon.is_empty:
        raise AreaError("WKT, but no polygon with corners; give POLYGON ((x y, ...), ...)")
    return _space_of(polygon)


def _from_json(text: str) -> Space:
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise AreaError(f"not JSON ({printable(str(error), 80)})") from None
    holes = root.get("holes_m", [])
    if not isinstance(holes, list):
        raise AreaError("holes_m: expected a list of rings, [[[east, north], ...], ...]")
    rings = [_ring(root.get("polygon_m"), "polygon_m")]
    rings += [_ring(hole, f"holes_m[{i}]") for i, hole in enumerate(holes)]
    return Space(rings[0], rings[1:])


def _ring(value: Any, key: str) -> list[Point]:
    found = []
    for i, place in enumerate(value if isinstance(value, list) else [value]):
        good = (
            isinstance(place, list)
            and len(place) == 2
            and all(type(v) in (int, float) for v in place)
        )
        if not good:
            shown = json.dumps(place)[:40]
            raise AreaError(f"{key}[{i}] = {shown}: expected [east, north] in metres")
        found.append((float(place[0]), float(place[1])))
    return found


def _from_area(name: str) -> Ground:
    drawing = read_area_file(name)
    if len(drawing.areas) > 1:
        names = ", ".join(area.name for area in drawing.areas[:5])
        raise AreaError(
            f"{len(drawing.areas)} areas ({names}); save the one to explore alone in a file"
        )
    area = drawing.areas[0]
    corner = LatLon(min(p.lat_deg for p in area.ring), min(p.lon_deg for p in area.ring))
    plane = LocalPlane(corner)

    def ring(positions: Positions) -> list[Point]:
        return [plane.to_plane(position) for position in positions]

    polygon = Polygon(ring(area.ring), [ring(hole) for hole in area.holes])
    if not polygon.is_valid:
        raise AreaError(f"{area.name}: its rings cross; draw it anew")
    zones = [Polygon(ring(zone.ring)).buffer(0.0) for zone in drawing.keep_out]
    left = polygon.difference(shapely.union_all(zones))
    if not isinstance(left, Polygon) or left.is_empty:
        raise AreaError(f"{area.name}: the keep-out zones leave no single piece of it; move them")
    return Ground(_space_of(left), plane)


def _space_of(polygon: Polygon) -> Space:
    return Space(
        [(x, y) for x, y, *_ in polygon.exterior.coords[:-1]],
        [[(x, y) for x, y, *_ in hole.coords[:-1]] for hole in polygon.interiors],
    )
