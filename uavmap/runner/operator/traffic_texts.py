"""Aircraft of others in words and as marks, for the terminal and the page."""

from __future__ import annotations

import math
from typing import Any, Final

from missions.flight.state import State
from missions.traffic import Answer, Track
from uavmap.base.printable import printable

MAX_SHOWN: Final = 20
"""Maximum number of aircraft on a page."""
_WINDS: Final = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
DOING: Final = {
    Answer.HOLD: "held for traffic",
    Answer.COME_HOME: "coming home for traffic",
}
"""The response of the whole mission to traffic."""
_ORDERED: Final = {
    Answer.HOLD: "vehicles hold; Continue ignores it",
    Answer.COME_HOME: "vehicles come home",
}


def traffic_news(before: State, now: State) -> str:
    """Return the line of a change of what the team does about traffic; empty where it is none."""
    answer = now.traffic.answer
    if answer is before.traffic.answer:
        return ""
    if answer is Answer.GO_ON:
        return "no traffic is near any more" + ("; it is paused" if now.paused else "")
    track = next((one for one in now.traffic.tracks if one.name == now.traffic.because), None)
    what = now.traffic.because if track is None else described(track, now)
    return f"traffic: {printable(what)}: {_ORDERED[answer]}"


def described(track: Track, state: State) -> str:
    """Return where an aircraft is, from the start: "DLH1, 850 m NE, 90 m up"."""
    east_m, north_m = track.at(state.t_s)
    bearing = math.atan2(east_m, north_m) + state.setting.grid.convergence_rad
    wind = _WINDS[round(bearing / (math.tau / 8.0)) % 8]
    up = "height unknown" if track.height_m is None else f"{track.height_m:.0f} m up"
    return f"{track.name}, {math.hypot(east_m, north_m):.0f} m {wind} of the start, {up}"


def traffic_marks(state: State) -> list[dict[str, Any]]:
    """Return the aircraft for a page's board, the nearest first: places in the moving frame.

    `toward_deg`, from true north, and `speed_m_s` are null where the velocity is unknown.
    """
    marks: list[dict[str, Any]] = []
    turned = state.setting.grid.convergence_rad
    for track in state.traffic.tracks[:MAX_SHOWN]:
        place = state.setting.grid.to_moving(track.at(state.t_s), state.t_s)
        toward_deg = speed_m_s = None
        if (velocity := track.velocity_m_s) is not None:
            toward_deg = round(math.degrees(math.atan2(*velocity) + turned) % 360.0, 1)
            speed_m_s = round(math.hypot(*velocity), 1)
        marks.append(
            {
                "ident": printable(track.ident),
                "name": printable(track.name),
                "e": round(place.east_m, 1),
                "n": round(place.north_m, 1),
                "up": None if track.height_m is None else round(track.height_m),
                "toward_deg": toward_deg,
                "speed_m_s": speed_m_s,
                "words": printable(described(track, state)),
            }
        )
    return marks
