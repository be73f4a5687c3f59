"""Time of a flight over `bay`, and bytes on the air, by the size of the team.

    python -m tests.benchmarks.fleet_growth                       1, 2, 5, 10, 20 by one service
    python -m tests.benchmarks.fleet_growth --comms free --vehicles 2,5
    python -m tests.benchmarks.fleet_growth --picture FILE        the same as a picture

The vehicles stand in a row on the pier, 15 m apart, alternately of the lower and the higher layer.
With `--comms` each has a service and a layer of its own. More than five have no room for that below
the 42 m of `bay`, and map from higher. A line of JSON is printed for each team; `--picture` draws
such lines, read from standard input.
"""

from __future__ import annotations

import json
import math
import re
import sys
import time
from pathlib import Path
from typing import Any

from missions.geo.grid import Grid
from missions.units import GridPoint
from tests.benchmarks import frame
from tests.benchmarks.svg import BLUE, INK, PALE, RED, dot, drawing, label, line
from tests.support.plans import named_text
from uavmap.load.mission_source import load
from uavmap.runner.flight import fly
from uavmap.runner.simulated_fleet import fly_fleet

GAP_M = 15.0
HIGHEST_M, LOWEST_M, LAYERS_M = 42.0, 30.0, 3.0
"""Heights from which five of a fleet map, each in its own layer, m."""
TEAMS = (1, 2, 5, 10, 20)
FIGURES = (
    "makespan_s", "completed", "cells_missed", "false_positives", "fence_breaches",
    "reserve_violations", "min_separation_m", "sorties",
)  # fmt: skip


def text_for(vehicles: int, *, apart: bool = False) -> str:
    """Return the text of `bay` for a team of this size.

    `apart` is for a service on each: each has a layer of its own. More than five of those map from
    higher than in `bay`, so that the lowest still sees 3 x 3 of its cells at once.
    """
    source = named_text("bay")
    mission = load("bay")
    grid = Grid.at(mission.home, mission.grid.cell_m)
    numbers = sorted(range(vehicles), key=lambda k: (k % 2, k))
    pads = [GridPoint(round((k - (vehicles - 1) / 2) * GAP_M, 1), 0.0) for k in numbers]
    sections = []
    for pad, k in zip(pads, numbers, strict=True):
        place = grid.position(pad)
        home = f"home = [{place.lat_deg:.7f}, {place.lon_deg:.7f}]"
        sections.append(f"[[vehicles]]\n{home}\nlayer = {k % 2}\n")
    before, _, rest = source.text.partition("[[vehicles]]")
    after = rest[re.search(r"(?m)^\[sim\]", rest).start() :]  # type: ignore[union-attr]
    text = before + "\n".join(sections) + "\n" + after
    if not apart:
        return text
    # (the file gives the lower of its two layers)
    raised_m = max(HIGHEST_M, LOWEST_M + LAYERS_M * (vehicles - 1)) - LAYERS_M
    return re.sub(r"(?m)^altitude_m = 39\.0.*$", f"altitude_m = {raised_m:.1f}", text, count=1)


def fly_and_measure(vehicles: int, comms: str | None, seed: int) -> dict[str, Any]:
    text, flying = text_for(vehicles, apart=comms is not None), fly if comms is None else fly_fleet
    begun_s = time.process_time()
    how = {"vehicles": vehicles, "comms": comms, "seed": seed}
    found = frame.summary_of("bay", text, fly=flying, **how)
    result = how | {name: found[name] for name in FIGURES}
    result["patches"] = len(found["patches"])
    result["cpu_s"] = round(time.process_time() - begun_s)
    if "bytes_on_air" in found:
        most = max(found["bytes_on_air"].values())
        result["most_kb_min"] = round(most / 1000.0 / (found["makespan_s"] / 60.0), 2)
    return result


def picture(rows: list[dict[str, Any]]) -> str:
    """Draw time and bytes sent by each over the size of the team, as SVG; sizes are logarithmic."""
    width, height, left, right, top, low = 520, 500, 60.0, 490.0, 40.0, 280.0
    bytes_top, bytes_low, most_kb = 350.0, 440.0, 5.0
    parts = [label(width / 2, 22, "bay: from the first lift-off to the last landing, minutes")]
    parts.append(label(width / 2, bytes_top - 14, "sent on the air, kB a vehicle and minute"))

    def x(vehicles: float) -> float:
        return left + (right - left) * math.log(vehicles / 1.0) / math.log(20.0)

    def y(minutes: float) -> float:
        return low - (low - top) * math.log(minutes / 4.0) / math.log(64.0 / 4.0)

    def y_of_bytes(kb: float) -> float:
        return bytes_low - (bytes_low - bytes_top) * kb / most_kb

    def curve(points: list[tuple[float, float]], colour: str) -> None:
        parts.append(line(points, colour))
        parts.extend(dot(a, b, 3, colour) for a, b in points)

    for minutes in (4, 8, 16, 32, 64):
        parts.append(line([(left, y(minutes)), (right, y(minutes))], PALE, 1.0))
        parts.append(label(left - 6, y(minutes) + 4, f"{minutes}", anchor="end"))
    for kb in (0, 5):
        parts.append(line([(left, y_of_bytes(kb)), (right, y_of_bytes(kb))], PALE, 1.0))
        parts.append(label(left - 6, y_of_bytes(kb) + 4, f"{kb}", anchor="end"))
    for vehicles in TEAMS:
        parts.append(label(x(vehicles), low + 18, f"{vehicles}"))
        parts.append(label(x(vehicles), bytes_low + 18, f"{vehicles}"))
    parts.append(label((left + right) / 2, bytes_low + 40, "vehicles", colour=INK))
    ordered = sorted(rows, key=lambda row: row["vehicles"])
    kinds = ((False, BLUE, "one service for all", 22), (True, RED, "a service on each", -8))
    for fleet, colour, name, below in kinds:
        mine = [row for row in ordered if (row["comms"] is not None) is fleet]
        points = [(x(row["vehicles"]), y(row["makespan_s"] / 60.0)) for row in mine]
        curve(points, colour)
        if points:
            at_x, at_y = points[0]
            parts.append(label(at_x + 10, at_y + below, name, anchor="start", colour=colour))
    told = [row for row in ordered if "most_kb_min" in row]
    curve([(x(row["vehicles"]), y_of_bytes(row["most_kb_min"])) for row in told], RED)
    return drawing(width, height, parts)


def main() -> None:
    options = frame.options_of(
        __doc__, vehicles=",".join(map(str, TEAMS)), comms=str, seed=1, picture=Path
    )
    if options.picture is not None:
        rows = [json.loads(text) for text in sys.stdin if text.strip()]
        options.picture.write_text(picture(rows))
        return
    for vehicles in map(int, options.vehicles.split(",")):
        print(json.dumps(fly_and_measure(vehicles, options.comms, options.seed)), flush=True)


if __name__ == "__main__":
    main()
