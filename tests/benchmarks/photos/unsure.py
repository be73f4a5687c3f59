"""Sites with ground that looks like the region and that no example shows.

    python -m tests.benchmarks.photos.unsure [--seeds 1 2 3]    a minute a site and seed

Of each rendered site (`tests.support.sites`) three photographs of the western half are painted,
`uavmap tune` learns, and `uavmap replay` maps, once; then the two pictures are painted that the map
asks for, and it is mapped again. Cells of the map are held against the truth: all of them, where
an unsure one counts as not region, and the sure ones.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from pathlib import Path

from tests.benchmarks.frame import asked
from tests.support import sites
from uavmap.photos.tune.selection import Counts
from uavmap.ui.cli import main as uavmap

SEEDS = (1, 2, 3)
NAMES = ("track", "burn", "flood", "spill")
ASKED = 2
HEAD = "site   seed painted        all: IoU prec. rec.  sure: IoU prec. rec.  share wrong bound"


def run(*arguments: str) -> None:
    """Run a command of ours quietly. Raises `SystemExit` with its output where it fails."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = uavmap(list(arguments))
    if code not in (0, 3):
        raise SystemExit(f"{arguments} has failed\n{said.getvalue()}")


def figures(out: Path, eyes: Path, place: sites.Site) -> str:
    """A map against the truth."""
    region, unsure, truth = sites.judged_cells(out, place)
    rows = [Counts.of(region, truth, known) for known in (unsure | True, ~unsure)]
    wrong = float((region != truth)[~unsure].mean())
    bound = json.loads((eyes / "model.json").read_text("utf-8"))["wrong_at_most"]
    told = "      ".join(f"{c.iou:.2f}  {c.precision:.2f}  {c.recall:.2f}" for c in rows)
    return f"     {told}   {1 - unsure.mean():.2f} {wrong:.3f} {bound:.3f}"


def drill(name: str, seed: int, folder: Path) -> None:
    """One site, mapped twice."""
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
        print(f"{name:6} {seed:4} {painted:13} {figures(out, eyes, place)}", flush=True)
        lines = (out / "next.txt").read_text("utf-8").splitlines()[:ASKED]
        names = {Path(line.split("\t")[0]).stem for line in lines}
        sites.paint([shot for shot in shots if shot.name in names], masks)


def main() -> None:
    """Print two lines for each site and seed."""
    seeds = asked(__doc__, seeds=SEEDS).seeds
    print(HEAD)
    for seed in seeds:
        for name in NAMES:
            with tempfile.TemporaryDirectory() as folder:
                drill(name, seed, Path(folder))


if __name__ == "__main__":
    main()
