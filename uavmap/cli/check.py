"""uavmap check: what is wrong with a mission file, or what would be flown."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

from missions.energy import CLIMB_SPEED_M_S, LANDING_OVERHEAD_S, LANDING_SPEED_M_S
from missions.ground.lanes import search_length_m, share_out
from missions.state import Setting
from missions.units import GridPoint
from uavmap.mission_source import load_source


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "check",
        help="check a mission file and say what would be flown",
        description="Say what is wrong with a mission file, by key, or what it would fly.",
        epilog="examples:\n  uavmap check runway\n  uavmap check field.toml --json",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("mission", metavar="MISSION", help="a mission file, or a shipped mission")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check."""
    setting = Setting.of(load_source(options.mission).parse())
    figures = estimate(setting)
    if options.json:
        json.dump(figures, sys.stdout, indent=2)
        sys.stdout.write("\n")
        return 0
    print(f"{options.mission}: nothing wrong")
    width = max(map(len, figures))
    for key, value in figures.items():
        print(f"  {key:{width}}  {value}")
    return 0


def estimate(setting: Setting) -> dict[str, Any]:
    """What a mission would fly at most: a search of the whole box, and nothing found.

    Exploration comes on top; nobody knows how large the ROI is, so it is given per cell.
    """
    mission, energy = setting.mission, setting.energy
    blocks = share_out(setting.lanes, len(mission.vehicles)) if setting.lanes else ()
    home = GridPoint(0.0, 0.0)
    lengths = [search_length_m(block, home) for block in blocks]
    longest_m = max(lengths, default=0.0)
    layer_m = mission.altitude_m(len(mission.vehicles) - 1)
    overhead_s = layer_m / CLIMB_SPEED_M_S + layer_m / LANDING_SPEED_M_S + LANDING_OVERHEAD_S
    legs = 2 * max((len(block) for block in blocks), default=0) + 1
    search_s = longest_m / energy.speed_m_s + legs * energy.speed_m_s / energy.accel_m_s2
    usable_s = mission.battery.endurance_s * (1.0 - mission.battery.reserve) - overhead_s
    across_m, along_m = _footprint(setting)
    return {
        "mission": mission.name,
        "strategy": mission.strategy,
        "vehicles": len(mission.vehicles),
        "lanes": len(setting.lanes),
        "search_length_m": round(sum(lengths), 1),
        "search_time_s": round(search_s + overhead_s, 1),
        "search_sorties": math.ceil(search_s / max(usable_s, 1.0)),
        "usable_flight_s_per_battery": round(usable_s, 1),
        "exploration_s_per_cell": round(
            2.0 * mission.grid.cell_m / energy.speed_m_s + setting.look_s, 1
        ),
        "footprint_m": [round(across_m, 1), round(along_m, 1)],
        "turn_back_reserve_wh": round(energy.reserve_wh, 2),
    }


def _footprint(setting: Setting) -> tuple[float, float]:
    camera = setting.mission.camera
    across_m = 2.0 * setting.mission.altitude_m(0) * math.tan(math.radians(camera.hfov_deg) / 2.0)
    return across_m, across_m * camera.height_px / camera.width_px
