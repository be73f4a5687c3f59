"""The plan of a mission as a file to look at: `uavmap check --map`, and what `uavmap new` shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from shapely.geometry import Polygon

from missions.errors import OutputError
from missions.flight.setting import Setting
from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.places import drawn
from uavmap.base.atomic_write import write_bytes
from uavmap.output.drawing.preflight_scene import preflight_scene
from uavmap.output.drawing.raster import encode_png
from uavmap.output.drawing.sheet import draw_sheet
from uavmap.output.report.page import encode_plan

KINDS: Final = (".html", ".png")


def check_kind(path: Path, option: str) -> None:
    """Raise `OutputError` for a file of a kind that is not written."""
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{option} {path}: write a .html or a .png")


def write_map(setting: Setting, figures: Mapping[str, Any], path: Path) -> None:
    """Write the plan: a page (.html) or a picture (.png). Raises `OutputError`.

    `figures` are those of `uavmap.ui.cli.commands.check.estimate`.
    """
    facts = plan_facts(setting, figures)
    warnings = flyable.warnings(setting.mission, setting.grid)
    notes = [f"{name}: {value}" for name, value in (*facts, *(("note", w) for w in warnings))]
    scene = preflight_scene(setting, notes)
    if path.suffix.lower() == ".html":
        data = encode_plan(scene, facts, warnings)
    else:
        data = encode_png(draw_sheet(scene))
    try:
        write_bytes(path, data)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None


def plan_facts(setting: Setting, figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What stands beside a plan: name and value."""
    mission, home = setting.mission, setting.mission.home
    layers = ", ".join(f"{layer['altitude_m']:g} m" for layer in figures["layers"])
    battery = mission.battery
    return [
        ("home", f"{home.lat_deg:.6f}, {home.lon_deg:.6f} (latitude, longitude)"),
        ("UTM zone", zone_name(setting.grid)),
        ("box", box_line(setting)),
        (
            "fence",
            f"{_size(setting.fence.outer)}, holes: {len(mission.fence.holes)}; legs stay "
            f"{mission.fence.margin_m:g} m inside",
        ),
        ("cells", f"{mission.grid.cell_m:g} m"),
        ("vehicles", f"{len(mission.vehicles)}, strategy {mission.strategy}"),
        ("layers", f"{layers} above {'the start' if setting.ground is None else 'the ground'}"),
        ("lanes", f"{figures['lanes']}, {figures['search_length_m']:,.0f} m"),
        ("search", search_line(figures)),
        (
            "battery",
            f"{battery.capacity_wh:g} Wh, {battery.hover_power_w:g} W in hover: "
            f"{figures['usable_flight_s_per_battery'] / 60.0:.0f} min a sortie",
        ),
        ("wind", f"up to {mission.wind.speed_m_s:g} m/s"),
    ]


def search_line(figures: Mapping[str, Any]) -> str:
    """How long the search of the whole box takes, if nothing is found."""
    return (
        f"the search alone takes about {figures['search_time_s'] / 60.0:.0f} min, sorties of a "
        f"vehicle: {figures['search_sorties']}; exploring comes on top"
    )


def box_line(setting: Setting) -> str:
    """How large the box is."""
    return _size(drawn(setting.mission.search.box, setting.grid))


def _size(area: Polygon) -> str:
    west, south, east, north = area.bounds
    return f"{east - west:.0f} m x {north - south:.0f} m, {area.area:,.0f} m2"


def zone_name(grid: Grid) -> str:
    """The UTM zone with its hemisphere, and its EPSG number."""
    zone = grid.zone
    return f"{zone.number}{'S' if zone.south else 'N'} (EPSG:{zone.epsg})"
