"""How much of a mission is left, as far as anybody knows: what is known takes so long."""

from __future__ import annotations

from typing import Any

from missions.state import Phase, Setting, State

_OUT = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.LOST)


def time_left(setting: Setting, state: State) -> dict[str, Any]:
    """What is known to be left, shared out among those who fly, in seconds.

    `what` is what is left in words, `about_s` the time that it takes, None where nobody can say.
    Battery swaps and ways home are not counted, and a region may go on behind what is known.
    """
    team = sum(
        vehicle.phase not in _OUT and not vehicle.called_home for vehicle in state.vehicles.values()
    )
    if state.over or state.exploration_finished or not team:
        return {
            "what": "nothing more to explore" if state.exploration_finished else "",
            "about_s": None,
        }
    speed_m_s = setting.energy.speed_m_s
    if state.tree is None:
        left_m = sum(a.distance_to(b) for a, b in state.unsearched)
        return {
            "what": f"{left_m:.0f} m of search lanes",
            "about_s": round(left_m / speed_m_s / team),
        }
    known = [cell for cell, vertex in state.tree.vertices.items() if not vertex.looked]
    open_cells = [c for c in known if c not in state.abandoned and c not in state.skipped]
    if setting.nonstop:
        footprint = setting.mission.camera.optics.footprint(setting.mission.altitude_m(0))
        each_s = setting.grid.cell_m**2 / footprint.short_m / speed_m_s
    else:
        each_s = setting.look_s + setting.energy.leg_s(setting.grid.cell_m)
    cells = "1 known cell" if len(open_cells) == 1 else f"{len(open_cells)} known cells"
    return {
        "what": f"{cells} to look from",
        "about_s": round(len(open_cells) * each_s / team) or None,
    }
