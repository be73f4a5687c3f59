"""A drill for an unknown set: photographs with positions and few other tags.

    python -m tests.benchmarks.photos.unseen [--seeds 1 2 3 4]         about a minute a seed

The photographs are those of Brighton Beach without heading, height and gimbal in their tags. Each
is exposed up to a stop more or less than it was. Each is taken from up to 20 % higher or lower: it
is cut out of the photograph, which counts as taken from higher. Three of them are painted, `uavmap
tune` learns, and `uavmap replay` maps without a mission file. The cells of the map are compared
with the truth.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from missions.geo.grid import Grid
from tests.benchmarks.frame import options_of
from tests.benchmarks.photos import brighton
from uavmap.load.mission_source import load
from uavmap.photos.tune.selection import Counts
from uavmap.ui.cli import main as uavmap

SEEDS = (1, 2, 3, 4)
STOPS = 1.0
HEIGHTS = 0.2
WIDTH_PX, HEIGHT_PX = 2000, 1125
PAINTED = 3


def drill(seed: int, folder: Path) -> Counts:
    """Learn and map one set."""
    rng = np.random.default_rng(seed)
    photos, painted = folder / "photos", folder / "painted"
    for new in (photos, painted):
        new.mkdir()
    names = brighton.names()
    chosen = set(rng.choice(names, PAINTED, replace=False).tolist())
    for name in names:
        part = rng.uniform(1.0 - HEIGHTS, 1.0 + HEIGHTS) / (1.0 + HEIGHTS)
        stops = rng.uniform(-STOPS, STOPS)
        write(name, photos / f"{name}.jpg", part, stops)
        if name in chosen:
            truth = brighton.truth(name).astype(np.uint8) * 255
            cv2.imwrite(str(painted / f"{name}.png"), cut(truth, part, (500, 281)))
    eyes, out = folder / "eyes", folder / "map"
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        learned = uavmap(["tune", str(photos), "--examples", str(painted), "--out", str(eyes)])
        made = uavmap(["replay", str(photos), "--detector", str(eyes), "--out", str(out)])
    if learned or made not in (0, 3):  # 3: some ground is unsure
        raise SystemExit(f"seed {seed}: the drill has failed\n{said.getvalue()}")
    mission = load(str(out / "mission.toml"))
    return brighton.map_counts(out, Grid.at(mission.home, mission.grid.cell_m))


def cut(image: NDArray[np.uint8], part: float, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the middle of a picture, at a size."""
    rows, columns = image.shape[:2]
    matrix = np.array(
        [
            [part * columns / size[0], 0.0, (1.0 - part) * columns / 2.0],
            [0.0, part * rows / size[1], (1.0 - part) * rows / 2.0],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(image, matrix, size, flags=flags), np.uint8)


def write(name: str, path: Path, part: float, stops: float) -> None:
    """Write a photograph, cut and exposed again, with tags of time, place and focal length."""
    with Image.open(brighton.PHOTOGRAPHS / f"{name}.JPG") as photo:
        tags = photo.getexif()
        place, detail = tags.get_ifd(ExifTags.IFD.GPSInfo), tags.get_ifd(ExifTags.IFD.Exif)
        image = np.asarray(photo.convert("RGB"))
    linear = (np.arange(256) / 255.0) ** 2.2 * 2.0**stops
    levels = np.clip(255.0 * linear ** (1 / 2.2), 0, 255).round().astype(np.uint8)
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.GPSInfo).update({tag: place[tag] for tag in (1, 2, 3, 4)})
    told = exif.get_ifd(ExifTags.IFD.Exif)
    told[ExifTags.Base.DateTimeOriginal] = detail[ExifTags.Base.DateTimeOriginal]
    # one lens, as if all were cut alike; only the height differs
    told[ExifTags.Base.FocalLengthIn35mmFilm] = round(20 * (1.0 + HEIGHTS))
    made = Image.fromarray(cut(levels[image], part, (WIDTH_PX, HEIGHT_PX)))
    made.save(path, "JPEG", quality=90, exif=exif)


def main() -> None:
    """Print a line for each seed."""
    seeds = options_of(__doc__, seeds=SEEDS).seeds
    if not brighton.there():
        raise SystemExit(f"{brighton.PHOTOGRAPHS}: the photographs are not here")
    print("seed  precision recall IoU (cells)")
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            found = drill(seed, Path(folder))
        print(f"{seed:4}  {found.precision:9.3f} {found.recall:6.3f} {found.iou:5.3f}", flush=True)


if __name__ == "__main__":
    main()
