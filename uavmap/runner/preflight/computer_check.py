"""Whether this computer is fast enough for a mission, as findings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from missions.flight.path_orders import NOTICE_S
from missions.flight.setting import Setting
from uavmap.aircraft.path_stream import INTERVAL_S
from uavmap.runner.preflight.computer_speed import ComputerSpeed
from uavmap.runner.preflight.finding import Finding, bad, ok, warn

GAP_S: Final = 0.25
"""Longest gap between set-points in a flight, s. A PX4 leaves its path after 0.5 to 1 s."""
COMFORT_SHARE: Final = 0.5
"""Of what the mission needs: a computer that takes longer has little to spare."""
_FREE: Final = "end other programs on this computer, or take a faster one"


def computer_findings(
    speed: ComputerSpeed, setting: Setting | None, vehicles: int
) -> Iterator[Finding]:
    """Yield what was measured against what a mission with so many vehicles on here needs."""
    yield _finding(
        "event loop", speed.stall_s, GAP_S - INTERVAL_S, "late at worst",
        f"set-points go out every {INTERVAL_S:g} s, with gaps under {GAP_S:g} s", _FREE,
    )  # fmt: skip
    if setting is None:
        return
    if speed.frame_s is not None:
        each_s = setting.mission.camera.interval_s / vehicles
        yield _finding(
            "frames", speed.frame_s, each_s, "to judge one",
            f"{vehicles} x {1.0 / setting.mission.camera.interval_s:g} frames a second",
            "raise camera.interval_s, take fewer pixels or a faster detector, or a faster computer",
        )  # fmt: skip
    if speed.plan_s is not None:
        yield _finding(
            "plans", speed.plan_s, NOTICE_S, "for the slowest",
            f"a path begins {NOTICE_S:g} s after it is asked for", _FREE,
        )  # fmt: skip


def _finding(what: str, took_s: float, most_s: float, of: str, need: str, remedy: str) -> Finding:
    found = f"{1000.0 * took_s:.0f} ms {of}"
    wanted = f"at most {1000.0 * most_s:.0f} ms: {need}"
    if took_s > most_s:
        return bad(what, found, wanted, remedy)
    if took_s > COMFORT_SHARE * most_s:
        return warn(what, found, wanted, remedy)
    return ok(what, f"{found}; {wanted}")
