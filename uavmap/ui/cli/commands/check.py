"""uavmap check: the faults of a mission file, or the plan of its flight."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from shapely.geometry import Polygon

from missions.errors import OutputError
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.places import drawn
from uavmap.load.detector_source import region_in_words, region_lines, require_detector
from uavmap.load.mission_source import load
from uavmap.output.documents import save
from uavmap.output.drawing.map_scene import preflight_scene
from uavmap.output.drawing.raster import encode_png
from uavmap.output.drawing.sheet import draw_sheet
from uavmap.output.report.page import encode_plan
from uavmap.runner.preflight.plan_figures import (
    default_lines,
    estimate,
    first_sighting_s,
    ground_figures,
    ground_lines,
    zone_lines,
)
from uavmap.ui.cli.option_table import add_options

KINDS: Final = (".html", ".png")
DESCRIPTION: Final = "List the faults of a mission file, by key, or print the plan of its flight."
EXAMPLES: Final = """\
  uavmap check runway                           the plan of a shipped mission
  uavmap check field.toml --json
  uavmap check field.toml --map field.html      the plan as a page
"""
NOTES: Final = ""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_options(parser, "check")
    parser.add_argument(
        "--map",
        metavar="FILE.html|FILE.png",
        type=Path,
        help="draw box, fence, lanes and homes, as a page without external files or as a picture",
    )


def run(options: argparse.Namespace) -> int:
    """Check the mission file and print the plan."""
    if options.map is not None:
        check_kind(options.map, "--map")
    mission = load(options.mission)
    require_detector(mission.detector, options.mission)
    setting = setting_of(mission)
    figures, sighted_s = estimate(setting), first_sighting_s(setting)
    warnings = flyable.warnings(setting.mission, setting.grid)
    if options.map is not None:
        write_map(setting, figures, options.map)
    if options.json:
        if sighted_s is not None:
            soon_s, late_s = sighted_s
            figures["first_sighting_s"] = round(soon_s, 1)
            figures["first_sighting_without_prior_s"] = round(late_s, 1)
        figures["ground"] = ground_figures(setting)
        figures["region"] = region_in_words(setting.mission.detector)
        figures["warnings"] = warnings
        figures["taken"] = default_lines(setting.mission)
        figures["zones"] = zone_lines(setting.mission)
        print(json.dumps(figures, indent=2))
        return 0
    print(f"{options.mission}: {'can be flown, with warnings' if warnings else 'no fault'}")
    for warning in warnings:
        print(f"  {warning}")
    for line in (*zone_lines(setting.mission), *default_lines(setting.mission)):
        print(f"  {line}")
    for line in region_lines(mission.detector):
        print(f"  {line}")
    print(f"  box {box_line(setting)}; UTM zone {zone_name(setting.grid)}")
    reason, rows = figures.pop("altitude_set_by"), figures.pop("layers")
    print(f"  height and speed of each layer; {reason} sets the height:")
    _print_layers(rows)
    if rows := figures.pop("search_layers"):
        print("  layers for the search of the box:")
        _print_layers(rows)
    if sighted_s is not None:
        soon_s, late_s = sighted_s
        print(
            f"  expected first sighting after about {soon_s:.0f} s "
            f"(without the prior {late_s:.0f} s)"
        )
    for line in ground_lines(setting):
        print(f"  {line}")
    width = max(map(len, figures))
    for key, value in figures.items():
        print(f"  {key:{width}}  {value}")
    if options.map is not None:
        print(f"  picture of the plan: {options.map}")
    return 0


def _print_layers(rows: Iterable[Mapping[str, Any]]) -> None:
    for layer in rows:
        across_m, along_m = layer["footprint_m"]
        print(
            f"    {layer['altitude_m']:g} m: a picture shows {across_m:g} m x {along_m:g} m, "
            f"{100 * layer['gsd_m']:.1f} cm a pixel, {layer['pixels_per_cell']:g} pixels a cell; "
            f"without stopping up to {layer['speed_m_s']:g} m/s ({layer['speed_set_by']})"
        )


# --- the plan as a picture or a page, also for `uavmap new` --------------------------------------
def check_kind(path: Path, option: str) -> None:
    """Raise `OutputError` for a file that is neither .html nor .png."""
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{option} {path}: must end with .html or .png")


def write_map(setting: Setting, figures: Mapping[str, Any], path: Path) -> None:
    """Write the plan, with figures of `estimate`, as .html or .png. Raises `OutputError`."""
    facts = plan_facts(setting, figures)
    warnings = flyable.warnings(setting.mission, setting.grid)
    notes = [f"{name}: {value}" for name, value in (*facts, *(("note", w) for w in warnings))]
    scene = preflight_scene(setting, notes)
    if path.suffix.lower() == ".html":
        data = encode_plan(scene, facts, warnings)
    else:
        data = encode_png(draw_sheet(scene))
    save(path, data)


def plan_facts(setting: Setting, figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the figures beside a plan: name and value."""
    mission, home = setting.mission, setting.mission.home
    layers = ", ".join(f"{layer['altitude_m']:g} m" for layer in figures["layers"])
    battery = mission.battery
    return [
        ("home", f"{home.lat_deg:.6f}, {home.lon_deg:.6f} (latitude, longitude)"),
        ("UTM zone", zone_name(setting.grid)),
        ("region", region_in_words(mission.detector)),
        ("box", box_line(setting)),
        (
            "fence",
            f"{_size(setting.fence.outer)}, holes: {len(mission.fence.holes)}; legs stay "
            f"{mission.fence.margin_m:g} m inside",
        ),
        *(("zone", line.removeprefix("zone ")) for line in zone_lines(mission)),
        ("cells", f"{mission.grid.cell_m:g} m"),
        ("vehicles", f"{len(mission.vehicles)}, strategy {mission.strategy}"),
        ("layers", f"{layers} above {'home' if setting.ground is None else 'the ground'}"),
        ("lanes", f"{figures['lanes']}, {figures['search_length_m']:,.0f} m"),
        ("search", search_line(figures)),
        (
            "battery",
            f"{battery.capacity_wh:g} Wh, {battery.hover_power_w:g} W in hover: "
            f"{figures['usable_flight_s_per_battery'] / 60.0:.0f} min per sortie",
        ),
        ("wind", f"up to {mission.wind.speed_m_s:g} m/s"),
    ]


def search_line(figures: Mapping[str, Any]) -> str:
    """Write the time to search the whole box if no region is found."""
    sorties = figures["search_sorties"]
    return (
        f"the search alone takes about {figures['search_time_s'] / 60.0:.0f} min and {sorties} "
        f"{'sortie' if sorties == 1 else 'sorties'} per vehicle; the exploration comes on top"
    )


def box_line(setting: Setting) -> str:
    """Write the size of the box."""
    return _size(drawn(setting.mission.search.box, setting.grid))


def _size(area: Polygon) -> str:
    west, south, east, north = area.bounds
    return f"{east - west:.0f} m x {north - south:.0f} m, {area.area:,.0f} m2"


def zone_name(grid: Grid) -> str:
    """Write the UTM zone with its hemisphere, and its EPSG number."""
    zone = grid.zone
    return f"{zone.number}{'S' if zone.south else 'N'} (EPSG:{zone.epsg})"
