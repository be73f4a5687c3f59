"""How good the map is by the pixels that a cell has: flights of `runway` from several heights.

    python -m tests.benchmarks.heights                    a table, about two minutes
    python -m tests.benchmarks.heights --pixels 60 --seeds 5

Every flight is a whole one in the simulator, with `flight.altitude_m = "auto"` and another
`camera.pixels_per_cell`. Sums over the seeds; of the IoU the mean.
"""

from __future__ import annotations

import argparse
import re
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

from missions.mission.checks import parse_mission
from tests.support.plans import named_text, plan_of
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly

PIXELS = (127, 80, 70, 60, 45, 30)
STRATEGY = "horizon"


def text_of(pixels: float) -> str:
    """The mission `runway` as high as so many pixels a cell allow."""
    text = re.sub(r"altitude_m = [0-9.]+", 'altitude_m = "auto"', named_text("runway").text)
    return re.sub(r"pixels_per_cell = [0-9.]+", f"pixels_per_cell = {pixels:g}", text)


def flight(text: str, seed: int) -> dict[str, Any]:
    """The summary of a flight."""
    plan = plan_of("runway", text, STRATEGY, 1, seed, (), None, SIM_EPOCH_UTC_S)
    with tempfile.TemporaryDirectory() as folder:
        return fly(plan, Path(folder))


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pixels", type=float, nargs="+", default=PIXELS)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args(arguments)
    print("| pixels a cell | height, m | IoU, % | cells missed | false + | false - | verdicts |")
    print("|---|---|---|---|---|---|---|")
    for pixels in options.pixels:
        text = text_of(pixels)
        height_m = parse_mission(text, "runway").altitude_m(0)
        found = [flight(text, seed) for seed in range(1, options.seeds + 1)]
        iou = 100.0 * statistics.fmean(f["iou_cells"] for f in found)
        counts = [
            sum(f[key] for f in found)
            for key in ("cells_missed", "false_positives", "false_negatives", "detections")
        ]
        cells = " | ".join(map(str, counts))
        print(f"| {pixels:g} | {height_m:g} | {iou:.1f} | {cells} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
