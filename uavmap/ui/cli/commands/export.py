"""uavmap export: files for ground stations from a mission, files for a GIS from a map."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import MissionFileError, OutputError, UavmapError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.load.mission_source import load
from uavmap.output.documents import FORMATS, Format, files_of, require_closed, save
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.ground_station_plan import (
    Firmware,
    SearchFlight,
    plan_text,
    search_flight,
    waypoints_text,
)
from uavmap.output.formats.wpml_encoder import AIRCRAFT, USUAL, wpml_archive
from uavmap.output.results import flown_of
from uavmap.ui.cli.common import refuse_existing, vehicle_count

EXAMPLES: Final = """\
  uavmap export field.toml --plan field.plan              the search lanes, for QGroundControl
  uavmap export field.toml --plan field.plan --firmware px4
  uavmap export field.toml --waypoints field.waypoints    for Mission Planner
  uavmap export spill --plan spill.plan                   three vehicles: spill-1.plan, -2, -3
  uavmap export spill --plan second.plan --vehicle 2
  uavmap export results/field-1 --to gpkg                 map.gpkg, with layers and styles, for QGIS
  uavmap export results/field-1 --to shp --out for-gis    Shapefiles, one per layer, in that folder
  uavmap export results/field-1 --to kml --out field.kml  tracks with time, for Google Earth
  uavmap export results/field-1 --to kmz                  the same over the mosaic, in one file
  uavmap export results/field-1 --to geopdf               map.pdf, a map with coordinates
  uavmap export results/field-1 --to stac                 stac-item.json, for a catalogue of imagery
  uavmap export field.toml --wpml field.kmz --drone M3T   the search lanes, for DJI Pilot 2
  uavmap export results/field-1 --to wpml --drone M3E     a flight over the mapped region
"""
NOTES: Final = """\
A plan has the fence, the home as rally point, and a flight along the search lanes with pictures,
from take-off to return. A WPML file has no fence. The autopilot flies these lanes and nothing else:
no detector judges the pictures, and only different heights separate the vehicles.
"""
DESCRIPTION: Final = (
    "Write the search of a mission for QGroundControl, Mission Planner or DJI Pilot 2. Or write "
    "the map of a flight for a GIS, also of an interrupted one."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add = parser.add_argument
    add(
        "source",
        metavar="MISSION|DIR",
        help="a mission file, a shipped mission, or the results folder of a mission",
    )
    add("--plan", metavar="FILE.plan", type=Path, help="write a plan for QGroundControl")
    add(
        "--waypoints",
        metavar="FILE.waypoints",
        type=Path,
        help="write QGC WPL 110 for Mission Planner, without fence and rally points",
    )
    add(
        "--wpml",
        metavar="FILE.kmz",
        type=Path,
        help="write waypoints for DJI Pilot 2 and FlightHub 2, without fence and rally points",
    )
    add(
        "--drone",
        choices=list(AIRCRAFT),
        default=USUAL,
        help=f"the DJI aircraft that flies the WPML file (default {USUAL})",
    )
    add(
        "--firmware",
        type=Firmware,
        choices=list(Firmware),
        default=Firmware.ARDUPILOT,
        help="the firmware of the vehicle, ardupilot or px4 (default ardupilot)",
    )
    add(
        "--vehicle",
        metavar="N",
        type=vehicle_count,
        help="write the flight of this vehicle alone, counted from 1 (default: a file for each "
        "vehicle)",
    )
    add(
        "--above-sea",
        action="store_true",
        help="write heights above the sea (start.amsl_m), not above home",
    )
    add(
        "--to",
        choices=list(FORMATS),
        help="write the results as a GeoPackage (gpkg), Shapefiles (shp), geojson, kml with times, "
        "gpx or csv. Or write KML with the mosaic (kmz), a STAC item (stac), a PDF with "
        "coordinates (geopdf), or a flight over the region (wpml)",
    )
    add(
        "--out",
        metavar="PATH",
        type=Path,
        help="with --to: the file, or the folder for shp, geojson and csv (default: in the results "
        "folder)",
    )


def run(options: argparse.Namespace) -> int:
    """Export a mission or a map."""
    terminal = Terminal()
    with shown_on(terminal):
        if options.to is not None or options.out is not None:
            return export_map(options, terminal.show)
        return export_search(options, terminal.show)


# --- a mission for a ground station -----------------------------------------------------------
def export_search(options: argparse.Namespace, show: Callable[[str], None]) -> int:
    """Write the search of a mission for ground stations. Raises `UavmapError`."""
    files = [path for path in (options.plan, options.waypoints, options.wpml) if path is not None]
    if not files:
        raise UavmapError(
            "no format; give --plan FILE.plan, --waypoints FILE.waypoints, --wpml FILE.kmz or "
            "--to FORMAT"
        )
    if len(set(files)) < len(files):
        raise UavmapError(f"{files[-1]}: is given twice; give each format its own file")
    if options.waypoints is not None and options.firmware is Firmware.PX4:
        raise UavmapError(
            "--waypoints: such a file begins with a home, to which a PX4 would fly; use --plan"
        )
    if options.wpml is not None and options.above_sea:
        raise UavmapError(
            "--above-sea: heights in a WPML file are above the take-off point; leave it out with "
            "--wpml"
        )
    if Path(options.source).is_dir():
        raise UavmapError(
            f"{options.source}: is a folder; give a mission file for a plan. To fly over the "
            "mapped region again, make a mission of it: uavmap new "
            f"{Path(options.source) / 'map.gpkg'} --area region. For a DJI aircraft: uavmap export "
            f"{options.source} --to wpml"
        )
    mission = load(options.source)
    if mission.flight.height_above == "ground":
        raise UavmapError(
            f'{options.source}: flight.height_above = "ground": heights in a plan are above home, '
            "and could lead into rising ground; use `uavmap fly`"
        )
    frame, home_amsl_m = _frame(options, mission), mission.start.amsl_m
    flights = _flights(options, mission, frame, show)
    made: dict[Path, bytes] = {}
    for flight in flights:
        # several vehicles get a file each: field-1.plan, field-2.plan
        number = f"-{flight.vehicle + 1}" if len(flights) > 1 else ""
        if options.plan is not None:
            made[options.plan.with_stem(f"{options.plan.stem}{number}")] = plan_text(
                options.firmware, flight.home, flight.fence, flight.rally, flight.items,
                home_amsl_m=home_amsl_m, speed_m_s=flight.speed_m_s, frame=frame,
            ).encode()  # fmt: skip
        if options.waypoints is not None:
            text = waypoints_text(flight.home, home_amsl_m, flight.items)
            made[options.waypoints.with_stem(f"{options.waypoints.stem}{number}")] = text.encode()
        if options.wpml is not None:
            data = wpml_archive(flight, options.drone)
            made[options.wpml.with_stem(f"{options.wpml.stem}{number}")] = data
    for path in made:  # write all files or none
        if path.exists():
            raise OutputError(f"{path}: already exists; choose another name, or move the file")
    for path, data in made.items():
        save(path, data)
        show(f"wrote {path}")
    return 0


def _flights(
    options: argparse.Namespace, mission: Mission, frame: int, show: Callable[[str], None]
) -> list[SearchFlight]:
    """Return the search of the vehicle of --vehicle, or of all vehicles with a lane to fly."""
    setting, flights, count = setting_of(mission), [], len(mission.vehicles)
    if options.vehicle is not None and options.vehicle > count:
        raise UavmapError(
            f"--vehicle {options.vehicle}: {options.source} has {count} vehicles; give 1 to {count}"
        )
    for vehicle in range(count) if options.vehicle is None else (options.vehicle - 1,):
        flight = search_flight(setting, vehicle, frame)
        if flight.left_out:
            show(
                f"vehicle {vehicle + 1}: {len(flight.left_out)} lanes are left out: no path inside "
                "the fence leads to them"
            )
        if len(flight.left_out) == len(setting.shares[vehicle]):
            show(f"vehicle {vehicle + 1} has no lane to fly; no file is written for it")
            continue
        flights.append(flight)
    if not flights:
        raise MissionFileError(f"{options.source}: no lane can be flown; no file is written")
    if mission.drift.speed_m_s:
        show("the region drifts, but the lanes of the plan stay over the box")
    return flights


def _frame(options: argparse.Namespace, mission: Mission) -> int:
    if not options.above_sea:
        return int(mav.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    if "amsl_m" not in mission.start.model_fields_set:
        raise MissionFileError(
            f"{options.source}: start.amsl_m is missing, and --above-sea needs it; add the height "
            "of the start above the sea"
        )
    return int(mav.MAV_FRAME_GLOBAL)


# --- a map for a GIS --------------------------------------------------------------------------
_PLAN_OPTIONS = ("plan", "waypoints", "wpml", "vehicle", "above_sea")


def export_map(options: argparse.Namespace, show: Callable[[str], None]) -> int:
    """Write a map for a GIS. Raises `UavmapError`."""
    _check(options)
    folder = Path(options.source)
    flown, made = flown_of(folder), FORMATS[options.to]
    report_incomplete(flown, show)
    files = files_of(
        flown, options.to, **({"drone": options.drone} if options.to == "wpml" else {})
    )
    shown = options.out or folder / made.name
    target = shown if made.several else shown.parent
    if not made.several:
        files = dict.fromkeys([shown.name], *files.values())
    if options.out is not None:
        _refuse_existing(shown, files, made)
    for name in files:
        require_closed(target / name)
    _write_map(target, files, made)
    size_kb = sum(map(len, files.values())) / 1000.0
    end, many = (os.sep, f"{len(files)} files, ") if made.several else ("", "")
    show(f"{shown}{end} ({many}{size_kb:,.0f} kB)")
    return 0


def report_incomplete(flown: FlownMission, show: Callable[[str], None]) -> None:
    """Show a line for a map that is not complete."""
    if flown.values.get("no_verdict"):
        show(f"{flown.folder}: {flown.values['finding']}")
    elif not flown.completed:
        show(
            f"{flown.folder}: the mission is not complete; this is its map so far, at mission time "
            f"{flown.data.t_s:.0f} s"
        )


def _check(options: argparse.Namespace) -> None:
    if options.to is None:
        raise UavmapError("--out needs --to FORMAT; name the file of a plan with --plan")
    for name in _PLAN_OPTIONS:
        if getattr(options, name):
            raise UavmapError(f"--{name.replace('_', '-')} is for a plan; leave it out with --to")
    folder = Path(options.source)
    if not folder.is_dir():
        raise UavmapError(
            f"{options.source}: not a results folder with a {JOURNAL}, which --to needs; for a "
            "mission use --plan, --waypoints or --wpml"
        )
    out, beside = options.out, FORMATS[options.to].beside
    if beside and out is not None and out.parent.resolve() != folder.resolve():
        raise UavmapError(
            f"--out {out}: a STAC item names the files beside it; give a name in {folder}, then "
            "copy the whole folder"
        )


def _refuse_existing(out: Path, files: Mapping[str, bytes], made: Format) -> None:
    if not made.several:
        if out.exists():
            raise OutputError(f"--out {out}: already exists; choose another name")
        return
    if out.exists() and not out.is_dir():
        raise OutputError(f"--out {out}: is a file; give a folder")
    refuse_existing(out, files)


def _write_map(target: Path, files: Mapping[str, bytes], made: Format) -> None:
    if made.several:
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{target}: cannot be written ({error.strerror})") from None
    elif not target.is_dir():
        raise OutputError(f"{target}: cannot be written (there is no folder {target})")
    for name, data in files.items():
        save(target / name, data)
