"""Two aircraft without satellites map a small box: one hovers and tracks the other."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

from missions.events import Navigated
from missions.flight.state import Setting
from sitl.vehicle import SimVehicle
from tests.benchmarks.frame import truth_shown
from tests.benchmarks.watched import fly_watched
from tests.support.small_missions import mission_text, square

LOST_S = 22.0
TABLES = """
[navigation]
gnss_loss = "leapfrog"
tag_m = 0.6

[detector]
dilations = 4

[sim]
optical_flow = true
odometry_drift = 0.03
gps_sigma_m = 0.1

[[sim.faults]]
kind = "gps"
at_s = 22.0

[[sim.faults]]
kind = "gps"
vehicle = 2
at_s = 22.0
"""


def test_vehicles_without_satellites_know_their_positions_by_leapfrog():
    text = mission_text(
        square(2, 6, 14, 8), square(-20, -20, 60, 60), vehicles=2, capacity_wh=60.0,
        strategy="leapfrog", layer_m=8.0, mounting="gimbal", interval_s=0.5,
        regions=[square(4, 7, 8, 6)],
    )  # fmt: skip
    text = text.replace(
        "[camera]\n", "[camera]\nwidth_px = 320\nheight_px = 240\npixels_per_cell = 40\n"
    )
    errors: dict[int, list[tuple[float, float, float]]] = {1: [], 2: []}

    def record(vehicles: Sequence[SimVehicle], _: Setting) -> None:
        for vehicle in vehicles:
            truth = vehicle.truth
            errors[vehicle.spec.system_id].append((truth.t_s, *truth.estimate_error_m))

    with truth_shown(record):
        flight = fly_watched("leapfrog", text + TABLES, 3)
    assert (flight.code, flight.summary["cells_missed"]) == (0, 0), flight.line()
    assert set(flight.summary["navigation"]) == {"1", "2"}
    told = [e for e in flight.events if isinstance(e, Navigated) and e.off_m is not None]
    assert {event.vehicle for event in told} == {1, 2}
    for event in told:
        assert event.gnss == "lost"
        track = errors[event.vehicle]
        _, east_m, north_m = track[bisect.bisect_left(track, (event.t_s,))]
        left_m = math.hypot(event.off_m.east_m - east_m, event.off_m.north_m - north_m)
        assert left_m < max(0.5, 4.0 * event.sigma_m)
    last = max(e.t_s for e in told)
    assert last > LOST_S + 30.0
