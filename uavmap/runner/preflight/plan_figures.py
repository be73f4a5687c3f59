"""The plan of a mission, in figures and in lines, before anything flies."""

from __future__ import annotations

import math
from typing import Any, Final

from missions.flight.state import Setting
from missions.mission import flyable
from missions.mission.energy import CLIMB_OVERHEAD_S, LANDING_OVERHEAD_S
from missions.mission.height_and_speed import altitude_reason, off_if_flat_m, speed_limits
from missions.mission.places import far_homes
from missions.mission.schema import Mission
from missions.planning.search.lanes import search_length_m
from missions.planning.search.search_order import expected_s, plain_blocks
from missions.units import GridPoint


def estimate(setting: Setting) -> dict[str, Any]:
    """Return the maximum flight of a mission: a search of the whole box, without a find.

    Exploration is given per cell, of strategies that observe every cell: the ROI's size is unknown.
    `sortie_wh` is the energy of a full battery without climb, landing and reserve.
    `farthest_corner_wh` is the part of it for the farthest corner of the box, there and back, with
    an observation.
    """
    mission, energy = setting.mission, setting.energy
    blocks, team = setting.shares, range(len(setting.mission.vehicles))
    home = GridPoint(0.0, 0.0)
    lengths = [search_length_m(block, home) for block in blocks]
    layer_m = mission.top_altitude_m(len(mission.vehicles) - 1)
    overhead_s = layer_m / energy.climb_m_s + energy.descent_s(layer_m) + LANDING_OVERHEAD_S
    search_s = setting.strategy.search_s(setting)
    usable_s = mission.battery.endurance_s * (1.0 - mission.battery.reserve) - overhead_s
    area = flyable.search_area(mission, setting.grid)
    corner = flyable.farthest_corner(mission, setting.grid)
    corner_layer_m = mission.top_altitude_m(corner.vehicle)
    # not for flying: the climb, the landing and the reserve
    aside_wh = energy.climb_wh(corner_layer_m) + energy.home_wh(0.0, corner_layer_m)
    aside_wh -= energy.leg_wh(0.0)
    a_cell_s = 2.0 * mission.grid.cell_m / energy.speed_m_s + setting.look_s
    looks = {} if not setting.strategy.stops else {"exploration_s_per_cell": round(a_cell_s, 1)}
    return {
        "mission": mission.name,
        "strategy": mission.strategy,
        "vehicles": len(mission.vehicles),
        "lanes": len(setting.lanes),
        "search_area_m2": round(area.box_m2, 1),
        "cut_off_m2": round(area.cut_off_m2, 1),
        "search_length_m": round(sum(lengths), 1),
        "search_time_s": round(search_s + overhead_s, 1),
        "search_sorties": math.ceil(search_s / max(usable_s, 1.0)),
        "usable_flight_s_per_battery": round(usable_s, 1),
        **looks,
        "altitude_set_by": altitude_reason(mission),
        "layers": [_figures(mission, mission.altitude_m(k)) for k in team],
        "search_layers": [
            _figures(mission, height_m)
            for height_m in map(mission.search_altitude_m, team)
            if height_m is not None
        ],
        "turn_back_reserve_wh": round(energy.reserve_wh, 2),
        "sortie_wh": round(energy.capacity_wh - aside_wh, 2),
        "farthest_corner_m": round(corner.away_m, 1),
        "farthest_corner_wh": round(corner.sortie_wh - aside_wh, 2),
    }


def first_sighting_s(setting: Setting) -> tuple[float, float] | None:
    """Return the expected time from lift-off to the first sighting, with and without the prior, s.

    None without a prior. Other vehicles, batteries and obstacles cost no time in it.
    """
    if not setting.likely:
        return None
    of_lane = {each.lane: each for part in setting.likely for each in (part, part.turned)}
    blocks = [tuple(of_lane[lane] for lane in block) for block in setting.shares]
    plain, pace = plain_blocks(setting.likely, len(blocks)), setting.strategy.pace(setting)
    climb_s = setting.mission.top_altitude_m(0) / setting.energy.climb_m_s + CLIMB_OVERHEAD_S
    soon_s, late_s = (climb_s + expected_s(b, setting.pads, pace) for b in (blocks, plain))
    return soon_s, late_s


def ground_figures(setting: Setting) -> dict[str, Any] | None:
    """Return the figures of the ground, in metres above the start; None if it is unknown."""
    mission, relief = setting.mission, setting.mission.relief
    if relief is None:
        return None
    figures: dict[str, Any] = {
        "lowest_m": round(relief.lowest_m, 1),
        "highest_m": round(relief.highest_m, 1),
        "steepest_percent": round(100.0 * relief.steepest, 1),
        "off_if_flat_m": round(off_if_flat_m(mission, relief), 1),
        "followed": setting.ground is not None,
    }
    if setting.ground is not None:
        heights = [mission.altitude_m(i) for i in range(len(mission.vehicles))]
        figures["highest_flown_m"] = round(mission.highest_ground_m + max(heights), 1)
        figures["return_heights_m"] = [round(mission.highest_ground_m + h, 1) for h in heights]
    return figures


def ground_lines(setting: Setting) -> list[str]:
    """Return the same as text."""
    found = ground_figures(setting)
    if found is None:
        asked = setting.mission.terrain is not None
        return ["ground: asked of the autopilot before take-off"] if asked else []
    lines = [
        f"ground in the fence: {found['lowest_m']:+g} to {found['highest_m']:+g} m from the start, "
        f"slopes up to {found['steepest_percent']:g} %; taken as flat, cells would be off by up to "
        f"{found['off_if_flat_m']:g} m"
    ]
    if found["followed"]:
        returns = ", ".join(f"{height:g}" for height in found["return_heights_m"])
        lines.append(
            f"flown above the ground: up to {found['highest_flown_m']:g} m above the start "
            f"(fence.ceiling_m = {setting.mission.fence.ceiling_m:g}); return heights {returns} m"
        )
    return lines


def default_lines(mission: Mission) -> list[str]:
    """Return lines on the defaults of tables that a flight depends on and the file leaves out.

    >>> from uavmap.load.mission_source import load
    >>> default_lines(load("runway"))
    []
    """
    battery, camera, wind = mission.battery, mission.camera, mission.wind
    values = {
        "battery": f"{battery.capacity_wh:g} Wh, {battery.hover_power_w:g} W in hover, a reserve "
        f"of {100.0 * battery.reserve:g} %",
        "camera": f"{camera.hfov_deg:g} degrees across, {camera.width_px} x {camera.height_px} "
        f"pixels, {camera.mounting}",
        "wind": f"{wind.speed_m_s:g} m/s",
    }
    return [
        f"[{name}] is not in the file; taken: {value}"
        for name, value in values.items()
        if name not in mission.model_fields_set
    ]


def plan_lines(setting: Setting) -> list[str]:
    """Return the plan as lines for people who decide on take-off."""
    mission, figures = setting.mission, estimate(setting)
    cells = figures["search_area_m2"] / mission.grid.cell_m**2
    heights = ", ".join(f"{layer['altitude_m']:g} m" for layer in figures["layers"])
    above = "the start" if setting.ground is None else "the ground below"
    energy, battery = setting.energy, mission.battery
    return [
        f"{mission.name}: a box of about {cells:.0f} cells of {mission.grid.cell_m:g} m, by "
        f"{len(mission.vehicles)} vehicles, strategy {mission.strategy}",
        f"  heights above {above}: {heights}; at {mission.flight.speed_m_s:g} m/s",
        f"  the search alone: about {figures['search_time_s'] / 60.0:.0f} minutes, "
        f"{figures['search_sorties']} sorties a vehicle; exploring comes on top",
        f"  energy: {battery.capacity_wh:g} Wh a battery, {energy.reserve_wh:.1f} Wh of it "
        f"reserve, {battery.hover_power_w:g} W in hover",
        *(f"  {line}" for line in zone_lines(mission)),
        f"  fence: {setting.fence.outer.area:.0f} m2, {len(mission.fence.holes)} holes, legs stay "
        f"{mission.fence.margin_m:g} m inside",
        *(f"  {line}" for line in default_lines(mission)),
        *(f"  {line}" for line in far_homes(mission, setting.grid)),
        *(f"  {line}" for line in ground_lines(setting)),
    ]


def _figures(mission: Mission, height_m: float) -> dict[str, Any]:
    """Return the figures of a layer's height; `speed_m_s` is for pictures without a stop."""
    optics, speeds = mission.camera.optics, speed_limits(mission, height_m)
    across_m, along_m = optics.footprint(height_m)
    return {
        "altitude_m": round(height_m, 1),
        "footprint_m": [round(across_m, 1), round(along_m, 1)],
        "gsd_m": round(optics.gsd_m(height_m), 4),
        "pixels_per_cell": round(optics.pixels_per_cell(height_m, mission.grid.cell_m), 1),
        "speed_m_s": math.floor(speeds.least_m_s * 10.0) / 10.0,
        "speed_set_by": speeds.reason,
        "speed_without_blur_m_s": round(speeds.blur_m_s, 1),
        "speed_with_enough_frames_m_s": round(speeds.frames_m_s, 1),
    }


_EFFECTS: Final = {
    "hole": "the fence leaves it out",
    "above": "it begins above fence.ceiling_m, and does not matter",
    "allowed": "it is flown in, by fence.allowed_zones",
}


def zone_lines(mission: Mission) -> list[str]:
    """Return a line for each zone that meets the fence: its name, why, and what follows."""
    return [
        f"zone {zone.name!r}: {zone.why}: {_EFFECTS[zone.effect]}" for zone in mission.fence.zones
    ]
