"""Photographs of four classes: painted, learned and mapped; and the time to judge them.

    python -m tests.benchmarks.photos.classes [--seeds 1 2 3]    a minute a seed

Four photographs of the rendered site `slick` (`tests.support.ground.sites`) are painted by class.
`uavmap tune` learns, `uavmap replay` maps. By class: IoU of the cells, the true area beside the
bounds of the map, the litres. The last lines have the time to judge a photograph of 1000 x 750 px,
and that to decode one of several sizes for it.
"""

from __future__ import annotations

import json
import tempfile
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from missions.mission.sections import DetectorSection
from tests.benchmarks.frame import cpu_ms, options_of
from tests.benchmarks.photos.unsure import run
from tests.support.ground import sites
from uavmap.load.detector_source import detector_of_section, resolved_section
from uavmap.photos.sources.photo_file import decoded
from vision.detectors import Detector
from vision.detectors.interface import judged

SEEDS = (1, 2, 3)
PAINTED = 4
WIDE_PX = 1000
NOISE = 6.0
"""Noise of a large photograph, standard deviation in levels: its file has 5 MB, as a camera's."""


def detector_in(folder: Path) -> Detector:
    """Return the detector of a folder of `uavmap tune`."""
    table = resolved_section(None, Path(), folder)
    return detector_of_section(DetectorSection.model_validate(table))


def drill(seed: int, folder: Path) -> Detector:
    """Paint, learn, map and print; return the detector."""
    place = sites.site("slick", seed)
    shots = sites.photographed(place, seed)
    photos, masks = folder / "photos", folder / "painted"
    sites.write(shots, photos)
    sites.paint_classes(shots[3 :: len(shots) // PAINTED], masks)
    eyes, out = folder / "eyes", folder / "map"
    run("tune", str(photos), "--examples", str(masks), "--out", str(eyes))
    run("replay", str(photos), "--detector", str(eyes), "--refine", "off", "--no-ortho",
        "--out", str(out))  # fmt: skip
    found = sites.classes_of_cells(out, place)
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    for one in summary["classes"]:
        mapped, truth = (column == one["number"] for column in found.T)
        iou = np.count_nonzero(mapped & truth) / np.count_nonzero(mapped | truth)
        true_m2 = np.count_nonzero(place.numbers == one["number"]) * sites.GSD_M**2
        low_m2, high_m2 = one["area_low_m2"], one["area_high_m2"]
        print(
            f"{seed:4}  {one['name']:12} IoU {iou:.2f}  true {true_m2:7.0f} m2, "
            f"map {one['area_m2']:7.0f} ({low_m2:.0f} to {high_m2:.0f})  litres {one['volume_l']}",
            flush=True,
        )
    return detector_in(eyes)


def rate(detector: Detector) -> None:
    """Print the times to judge and to decode a photograph."""
    place = sites.site("slick", 1)
    image = sites.photographed(place, 1)[10].image
    judging_ms = cpu_ms(partial(judged, detector, image), times=9)
    print(f"judged, 1000 x 750 px: {judging_ms:.1f} ms")
    for width_px in (WIDE_PX, 4000, 5472):
        size = (width_px, width_px * 3 // 4)
        noise = np.random.default_rng(1).normal(0.0, NOISE, (size[1], size[0], 3))
        large = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC) + noise
        levels = np.clip(large, 0, 255).astype(np.uint8)
        data = bytes(cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, 92])[1])
        ms = cpu_ms(partial(decoded, data, WIDE_PX), times=9)
        share = ms / judging_ms
        print(f"decoded from {width_px} px: {ms:.1f} ms; judging runs at {share:.2f} of that rate")


def main() -> None:
    """Print a line for each seed and class, and the rate."""
    for seed in options_of(__doc__, seeds=SEEDS).seeds:
        with tempfile.TemporaryDirectory() as folder:
            detector = drill(seed, Path(folder))
    rate(detector)


if __name__ == "__main__":
    main()
