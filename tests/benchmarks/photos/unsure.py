"""Sites with ground that looks like the region and that no example shows.

    python -m tests.benchmarks.photos.unsure [--seeds 1 2 3]    a minute a site and seed

Of each rendered site (`tests.support.ground.sites`) three photographs of the western half are
painted. `uavmap tune` learns, and `uavmap replay` maps, once; then the two pictures are painted
that the map asks for, and it is mapped again. Cells of the map are compared with the truth: all of
them, where an unsure one counts as not region, and the sure ones. `ece` is the expected calibration
error of the photographs that were not painted. It is the mean distance between a cell's mean
probability, by tenths, and the share of truth.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.frame import options_of
from tests.support.ground import sites
from uavmap.photos.tune.examples import read_picture
from uavmap.photos.tune.selection import Counts, by_cell
from uavmap.ui.cli import main as uavmap
from vision.detectors.learned_model import LearnedDetector

SEEDS = (1, 2, 3)
NAMES = ("track", "burn", "flood", "spill")
ASKED = 2
HEAD = (
    "site   seed painted        all: IoU prec. rec.  sure: IoU prec. rec.  share wrong bound   ece"
)


def run(*arguments: str) -> None:
    """Run a command of uavmap quietly. Raises `SystemExit` with its output if it fails."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = uavmap(list(arguments))
    if code not in (0, 3):
        raise SystemExit(f"{arguments} has failed\n{said.getvalue()}")


def cell_means(pictures: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the means of the cells, of 1 m, of all pictures, whose values may be coarser."""
    cells = [by_cell(values, values.shape[1] / sites.PHOTO_M) for values in pictures]
    return np.concatenate([means.ravel() for means in cells])


def calibration_error(eyes: Path, photos: Path, shots: Sequence[sites.Shot]) -> float:
    """Return the expected calibration error over cells of photographs, as their files show them."""
    detector = LearnedDetector((eyes / "model.json").read_bytes())
    wide = sites.PHOTO_PX[0]
    pictures = [read_picture(photos / f"{shot.name}.jpg", wide) for shot in shots]
    marks = cell_means([np.asarray(detector.judged(picture).marks) for picture in pictures])
    truth = cell_means([shot.region.astype(np.float32) for shot in shots])
    tenth = np.minimum((marks * 10).astype(int), 9)
    off = np.bincount(tenth, marks - truth, minlength=10)
    return float(np.abs(off).sum() / len(marks))


def figures(out: Path, eyes: Path, place: sites.Site, error: float) -> str:
    """Return a map against the truth, and the calibration of its detector."""
    region, unsure, truth = sites.judged_cells(out, place)
    rows = [Counts.compare(region, truth, known) for known in (unsure | True, ~unsure)]
    wrong = float((region != truth)[~unsure].mean())
    bound = json.loads((eyes / "model.json").read_text("utf-8"))["wrong_at_most"]
    row = "      ".join(f"{c.iou:.2f}  {c.precision:.2f}  {c.recall:.2f}" for c in rows)
    return f"     {row}   {1 - unsure.mean():.2f} {wrong:.3f} {bound:.3f} {error:.3f}"


def drill(name: str, seed: int, folder: Path) -> None:
    """Map one site twice."""
    place = sites.site(name, seed)
    shots = sites.photographed(place, seed)
    photos, masks = folder / "photos", folder / "painted"
    sites.write(shots, photos)
    sites.paint(sites.western(shots), masks)
    for number, painted in enumerate(("three", "and two asked")):
        eyes, out = folder / f"eyes{number}", folder / f"map{number}"
        run("tune", str(photos), "--examples", str(masks), "--out", str(eyes))
        mapped = ("--refine", "off", "--no-ortho", "--out", str(out))
        run("replay", str(photos), "--detector", str(eyes), *mapped)
        others = [shot for shot in shots if not (masks / f"{shot.name}.png").exists()]
        error = calibration_error(eyes, photos, others)
        print(f"{name:6} {seed:4} {painted:13} {figures(out, eyes, place, error)}", flush=True)
        lines = (out / "next.txt").read_text("utf-8").splitlines()[:ASKED]
        names = {Path(line.split("\t")[0]).stem for line in lines}
        sites.paint([shot for shot in shots if shot.name in names], masks)


def main() -> None:
    """Print two lines for each site and seed."""
    seeds = options_of(__doc__, seeds=SEEDS).seeds
    print(HEAD)
    for seed in seeds:
        for name in NAMES:
            with tempfile.TemporaryDirectory() as folder:
                drill(name, seed, Path(folder))


if __name__ == "__main__":
    main()
