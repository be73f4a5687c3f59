"""What tracking each other is worth to two multicopters: the table of docs/cooperation.md.

python -m tests.benchmarks.leapfrog
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from missions.cooperation.leapfrog import TrackerView, plan_leapfrog
from missions.cooperation.leapfrog_errors import LeapfrogNoise, compare
from missions.cooperation.space import Point

_RUNS = 200
_LANE_M = 6.0


def lanes(length_m: float, lane_m: float) -> list[Point]:
    """A lawn-mower pattern of about that length."""
    count = max(1, round(length_m / (lane_m + _LANE_M)))
    rows = [((0.0, i * _LANE_M), (lane_m, i * _LANE_M)) for i in range(count)]
    return [place for i, row in enumerate(rows) for place in (row if i % 2 == 0 else row[::-1])]


def _plans() -> Iterator[tuple[str, list[Point]]]:
    for length_m in (50.0, 100.0, 200.0, 400.0):
        yield f"straight, {length_m:.0f} m", [(0.0, 0.0), (length_m, 0.0)]
    yield "lanes of 60 m", lanes(400.0, 60.0)


def main() -> None:
    """Print the table."""
    for drift_deg in (0.1, 0.3):
        for above_m in (10.0, 12.0):
            base = LeapfrogNoise.of_tracker(above_m)
            noise = LeapfrogNoise(place_m=base.place_m, drift_rad=math.radians(drift_deg))
            print(f"gyro {drift_deg} deg after a metre, tracker {above_m:.0f} m above")
            for name, path in _plans():
                found = compare(plan_leapfrog(path, TrackerView(above_m=above_m)), noise, _RUNS)
                print(
                    f"| {name} | {found.path_m:.0f} | {found.hops} | {found.tracked_m:.2f} | "
                    f"{found.alone_m:.2f} | {found.times_better:.1f} | {found.tracked_nees:.2f} | "
                    f"{found.alone_nees:.2f} |"
                )


if __name__ == "__main__":
    main()
