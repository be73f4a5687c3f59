"""uavmap export: a mission, or what was mapped, as files for ground stations and a GIS."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from missions.errors import MissionFileError, OutputError, UavmapError
from missions.mapping.evidence import evidence_of
from missions.mission_file.schema import Mission
from missions.state import Setting
from missions.units import LatLon
from uavmap.cli.common import number_type, vehicle_count
from uavmap.cli.export_map import add_map_options, export_map
from uavmap.fly.progress import Terminal
from uavmap.mission_source import load
from uavmap.offline.plan_file import Firmware, Survey, plan, waypoints
from uavmap.offline.plan_items import Above, Item, Profile, search_flight
from uavmap.offline.plan_survey import Overlap, SurveyFlight, survey_flight
from uavmap.record.flight_plan import JOURNAL, FlightPlan
from uavmap.record.journal import Journal
from uavmap.results.atomic import write_text
from uavmap.results.figures import figures
from uavmap.results.write_results import map_data

_EXAMPLES = """\
examples:
  uavmap export field.toml --plan field.plan              the search lanes, for QGroundControl
  uavmap export field.toml --plan field.plan --firmware px4
  uavmap export field.toml --waypoints field.waypoints    for Mission Planner
  uavmap export spill --plan spill.plan                   three vehicles: spill-1.plan, -2, -3
  uavmap export spill --plan second.plan --vehicle 2
  uavmap export results/field-1 --plan again.plan         the mapped region as a survey
  uavmap export results/field-1 --plan again.plan --height 30 --overlap 80 --side-overlap 60
  uavmap export results/field-1 --to gpkg                 map.gpkg, with layers and styles, for QGIS
  uavmap export results/field-1 --to shp --out for-gis    Shapefiles, a layer each, in that folder
  uavmap export results/field-1 --to kml --out field.kml  tracks in time, for Google Earth

A plan has the fence, the vehicle's home as rally point, and a flight that takes off, flies its
lines with pictures, comes back over its home and returns. Whoever flies it flies the lines and no
more: nobody looks at the pictures, and nobody keeps vehicles apart but their different heights.
"""
_FOR_RESULTS = ("height", "overlap", "side_overlap")


@dataclass(frozen=True, slots=True)
class _Exported:
    """The flight of one vehicle (from 0), to be written."""

    vehicle: int
    home: LatLon
    profile: Profile
    parts: Sequence[Item | Survey]
    items: Sequence[Item]


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "export",
        description="Write the search of a mission, or a survey of a mapped region, as a file for "
        "QGroundControl or Mission Planner; or a map and its flight, also of one that was "
        "interrupted, as files for a GIS.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "source",
        metavar="MISSION|DIR",
        help="a mission file, a shipped mission, or the results folder of a mission",
    )
    add("--plan", metavar="FILE.plan", type=Path, help="a plan for QGroundControl")
    add(
        "--waypoints",
        metavar="FILE.waypoints",
        type=Path,
        help="QGC WPL 110 for Mission Planner: without fence and rally points",
    )
    add(
        "--firmware",
        type=Firmware,
        choices=list(Firmware),
        default=Firmware.ARDUPILOT,
        help="of the vehicle, ardupilot or px4 (default ardupilot)",
    )
    add(
        "--vehicle",
        metavar="N",
        type=vehicle_count,
        help="of this vehicle alone, counted from 1 (default: of a mission all, a file each; of "
        "results 1)",
    )
    add(
        "--above-sea",
        action="store_true",
        help="of a mission: heights above the sea (start.amsl_m) instead of above the home",
    )
    add(
        "--height",
        metavar="M",
        type=number_type(float, 1, 1000),
        help="of results: metres above the home (default: the vehicle's height in the mission)",
    )
    percent = number_type(float, 0, 95)
    add("--overlap", metavar="PERCENT", type=percent, help="of results: along a line (default 75)")
    add(
        "--side-overlap",
        metavar="PERCENT",
        type=percent,
        help="of results: with the next line (default 65)",
    )
    add_map_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Export."""
    if options.to is not None or options.out is not None:
        return export_map(options, Terminal().say)
    if options.plan is None and options.waypoints is None:
        raise UavmapError(
            "nothing to write; give --plan FILE.plan, --waypoints FILE.waypoints or --to FORMAT"
        )
    if options.plan == options.waypoints:
        raise UavmapError(f"--plan and --waypoints are both {options.plan}; give each its own file")
    if options.waypoints is not None and options.firmware is Firmware.PX4:
        raise UavmapError(
            "--waypoints: the file begins with a home, which a PX4 would fly to; use --plan"
        )
    say = Terminal().say
    source = Path(options.source)
    if source.is_dir():
        mission, flights = _of_results(options, source, say)
    else:
        mission, flights = _of_mission(options, say)
    if mission.flight.height_above == "ground":
        raise UavmapError(
            f'{options.source}: flight.height_above = "ground": the heights of a plan are above '
            "home, which leads into ground that is not flat; fly it with `uavmap fly`"
        )
    texts: dict[Path, str] = {}
    for flight in flights:
        number = flight.vehicle + 1 if len(flights) > 1 else None
        if options.plan is not None:
            text = plan(mission, flight.home, flight.profile, flight.parts, options.firmware)
            texts[_numbered(options.plan, number)] = text
        if options.waypoints is not None:
            text = waypoints(mission, flight.home, flight.items)
            texts[_numbered(options.waypoints, number)] = text
    _write(texts, say)
    return 0


def _write(texts: dict[Path, str], say: Callable[[str], None]) -> None:
    """Write the files, all or, where one is there already, none. Raises `OutputError`."""
    for path in texts:
        if path.exists():
            raise OutputError(f"{path}: is there already; choose another name, or move it away")
    for path, text in texts.items():
        try:
            write_text(path, text)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror})") from None
        say(f"wrote {path}")


def _numbered(path: Path, number: int | None) -> Path:
    """The file of one of several vehicles: field.plan, vehicle 2 -> field-2.plan."""
    return path if number is None else path.with_name(f"{path.stem}-{number}{path.suffix}")


def _chosen(options: argparse.Namespace, mission: Mission) -> int | None:
    """The vehicle of --vehicle, counted from 0."""
    if options.vehicle is None:
        return None
    count = len(mission.vehicles)
    if options.vehicle > count:
        raise UavmapError(f"--vehicle {options.vehicle}: {options.source} has {count}")
    return int(options.vehicle) - 1


# --- of a mission -------------------------------------------------------------------------------
def _of_mission(
    options: argparse.Namespace, say: Callable[[str], None]
) -> tuple[Mission, list[_Exported]]:
    """The search lanes of one vehicle or of all."""
    for name in _FOR_RESULTS:
        if getattr(options, name) is not None:
            raise UavmapError(
                f"--{name.replace('_', '-')} is for a results folder, and {options.source} is none"
            )
    mission = load(options.source)
    above = _above(options, mission)
    setting = Setting.of(mission)
    chosen = _chosen(options, mission)
    flights = []
    for vehicle in range(len(mission.vehicles)) if chosen is None else (chosen,):
        flight = search_flight(setting, vehicle, above)
        if flight.left_out:
            say(
                f"vehicle {vehicle + 1}: {len(flight.left_out)} lanes are left out, no way inside "
                "the fence leads to them"
            )
        if len(flight.left_out) == len(setting.shares[vehicle]):
            say(f"vehicle {vehicle + 1} has no lane to fly; nothing is written for it")
            continue
        flights.append(_Exported(vehicle, flight.home, flight.profile, flight.items, flight.items))
    if not flights:
        raise MissionFileError(f"{options.source}: no lane can be flown; nothing is written")
    if mission.drift.speed_m_s:
        say("the region drifts; the lanes are those over the box, which does not")
    return mission, flights


def _above(options: argparse.Namespace, mission: Mission) -> Above:
    if not options.above_sea:
        return Above.HOME
    if "amsl_m" not in mission.start.model_fields_set:
        raise MissionFileError(
            f"{options.source}: start.amsl_m is missing, and --above-sea counts heights from it; "
            "add the height of the start above the sea"
        )
    return Above.SEA


# --- of results ---------------------------------------------------------------------------------
def _of_results(
    options: argparse.Namespace, folder: Path, say: Callable[[str], None]
) -> tuple[Mission, list[_Exported]]:
    """A survey of the mapped region, for one vehicle."""
    if options.above_sea:
        raise UavmapError("--above-sea is for a mission; a survey is flown above its home")
    with Journal.open(folder / JOURNAL) as journal:
        recorded = "replay" in journal.meta
        setting = Setting.of(FlightPlan.read(journal).mission)
        events = list(journal.events())
    state, found = figures(setting, events)
    mission = setting.mission
    data = map_data(setting, state, found, None, recorded=recorded, evidence=evidence_of(events))
    if not data.table.roi.any():
        raise UavmapError(f"{folder}: no region was mapped; there is nothing to survey")
    vehicle = _chosen(options, mission) or 0
    height_m = options.height or mission.altitude_m(vehicle)
    if height_m > mission.fence.ceiling_m:
        raise UavmapError(
            f"--height {height_m:g}: above fence.ceiling_m = {mission.fence.ceiling_m:g} of the "
            "mission; survey from lower"
        )
    default = Overlap()
    overlap = Overlap(
        default.front_percent if options.overlap is None else options.overlap,
        default.side_percent if options.side_overlap is None else options.side_overlap,
    )
    flight = survey_flight(
        setting, data.roi_cells, state.t_s, height_m=height_m, overlap=overlap, vehicle=vehicle
    )
    if not flight.surveys:
        raise UavmapError(f"{folder}: no line over the region lies inside the fence")
    _tell(flight, state.completed, bool(mission.drift.speed_m_s), state.t_s, say)
    exported = _Exported(vehicle, flight.home, flight.profile, flight.parts, flight.items)
    return mission, [exported]


def _tell(
    flight: SurveyFlight,
    completed: bool,
    drifts: bool,
    t_s: float,
    say: Callable[[str], None],
) -> None:
    """What whoever flies the survey has to know."""
    if not completed:
        say("the map is not complete; the survey is of what was mapped")
    if flight.holes:
        say(
            f"{flight.holes} holes of the region are dropped: a survey has none, and flies over "
            "them"
        )
    if flight.left_out:
        say(f"{flight.left_out} parts of the region are left out: they lie outside of the fence")
    if drifts:
        say(f"the region drifts; the survey is where it was at mission time {t_s:.0f} s")
