"""uavmap check: what is wrong with a mission file, or what would be flown."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from missions.flight.setting_of import setting_of
from missions.mission import flyable
from uavmap.load.mission_source import load
from uavmap.runner.preflight.plan_figures import estimate, ground_figures, ground_lines, taken_lines
from uavmap.ui.cli.plan_map import box_line, check_kind, write_map, zone_name

DESCRIPTION: Final = "Say what is wrong with a mission file, by key, or what it would fly."
EXAMPLES: Final = (
    "examples:\n  uavmap check runway\n  uavmap check field.toml --json\n"
    "  uavmap check field.toml --map field.html      the plan as a page to look at"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("mission", metavar="MISSION", help="a mission file, or a shipped mission")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument(
        "--map",
        metavar="FILE.html|FILE.png",
        type=Path,
        help="draw box, fence, lanes and homes, as a page that loads nothing, or as a picture",
    )


def run(options: argparse.Namespace) -> int:
    """Check."""
    if options.map is not None:
        check_kind(options.map, "--map")
    setting = setting_of(load(options.mission))
    figures = estimate(setting)
    warnings = flyable.warnings(setting.mission, setting.grid)
    if options.map is not None:
        write_map(setting, figures, options.map)
    if options.json:
        if setting.first_sighting_s is not None:
            soon_s, late_s = setting.first_sighting_s
            figures["first_sighting_s"] = round(soon_s, 1)
            figures["first_sighting_without_prior_s"] = round(late_s, 1)
        figures["ground"] = ground_figures(setting)
        figures["warnings"] = warnings
        figures["taken"] = taken_lines(setting.mission)
        print(json.dumps(figures, indent=2))
        return 0
    print(f"{options.mission}: {'can be flown, but' if warnings else 'nothing wrong'}")
    for warning in warnings:
        print(f"  {warning}")
    for line in taken_lines(setting.mission):
        print(f"  {line}")
    print(f"  box {box_line(setting)}; UTM zone {zone_name(setting.grid)}")
    reason, rows = figures.pop("altitude_set_by"), figures.pop("layers")
    print(f"  height and speed of each layer; {reason} sets the height:")
    _print_layers(rows)
    if rows := figures.pop("search_layers"):
        print("  the box is searched from layers of its own:")
        _print_layers(rows)
    if setting.first_sighting_s is not None:
        soon_s, late_s = setting.first_sighting_s
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
        print(f"  the plan is in {options.map}")
    return 0


def _print_layers(rows: Iterable[Mapping[str, Any]]) -> None:
    for layer in rows:
        across_m, along_m = layer["footprint_m"]
        print(
            f"    {layer['altitude_m']:g} m: a picture shows {across_m:g} m x {along_m:g} m, "
            f"{100 * layer['gsd_m']:.1f} cm a pixel, {layer['pixels_per_cell']:g} pixels a cell; "
            f"without stopping up to {layer['speed_m_s']:g} m/s ({layer['speed_set_by']})"
        )
