"""Quality of the map by the pixels of a cell: flights of `runway` from several heights.

    python -m tests.benchmarks.heights                    a table, about two minutes
    python -m tests.benchmarks.heights --pixels 60 --seeds 5

Every flight is a whole one in the simulator, with `flight.altitude_m = "auto"` and another
`camera.pixels_per_cell`. The table has sums over the seeds, and the mean of the IoU.
"""

from __future__ import annotations

import re
import statistics

from missions.mission.checks import parse_mission
from tests.benchmarks.frame import head, options_of, row, summary_of
from tests.support.plans import named_text
from tests.support.small_missions import first_patch

PIXELS = (127.0, 80.0, 70.0, 60.0, 45.0, 30.0)
COUNTS = ("cells_missed", "false_positives", "false_negatives", "detections")


def text_of(pixels: float) -> str:
    text = re.sub(
        r"altitude_m = [0-9.]+", 'altitude_m = "auto"', first_patch(named_text("runway").text)
    )
    return re.sub(r"pixels_per_cell = [0-9.]+", f"pixels_per_cell = {pixels:g}", text)


def main() -> None:
    options = options_of(__doc__, pixels=PIXELS, seeds=3)
    names = ("cells missed", "false +", "false -", "verdicts")
    print(head("pixels a cell", "height, m", "IoU, %", *names))
    for pixels in options.pixels:
        text = text_of(pixels)
        height_m = parse_mission(text, "runway").altitude_m(0)
        found = [
            summary_of("runway", text, strategy="horizon", vehicles=1, seed=seed)
            for seed in range(1, options.seeds + 1)
        ]
        iou = 100.0 * statistics.fmean(f["iou_cells"] for f in found)
        counts = [sum(f[key] for f in found) for key in COUNTS]
        print(row(f"{pixels:g}", f"{height_m:g}", f"{iou:.1f}", *counts), flush=True)


if __name__ == "__main__":
    main()
