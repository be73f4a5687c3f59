"""Speed of a replay beside the decoder, and its memory.

    python -m tests.benchmarks.photos.replay rate FOLDER            pictures a second, and decoding
    python -m tests.benchmarks.photos.replay rate FOLDER --refine on          with refined poses
    python -m tests.benchmarks.photos.replay rate FOLDER --detector my-field  by another detector
    python -m tests.benchmarks.photos.replay results FOLDER     seconds after the last picture
    python -m tests.benchmarks.photos.replay memory       1,000, 3,000 and 10,000 small pictures
    python -m tests.benchmarks.photos.replay memory --pictures 5000  over as much more ground
    python -m tests.benchmarks.photos.replay memory --around 300     over the ground of 300

Set OPENBLAS_NUM_THREADS=1, as the command `uavmap` does for itself.

The small pictures are a survey with the tags of a drone's. The ground is a patchwork that repeats
itself every 460 m: a road with plants on both sides. The pictures lie in legs of 100, with 75 %
overlap along and 50 % across, so more of them show more ground. With `--around` the first pictures
lie so, and the others are above the same ground, a little beside.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from missions.errors import ImageError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from tests.support.photographs import dji, write_photo
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.load.detector_source import detector_text
from uavmap.load.mission_source import mission_of_text
from uavmap.photos.ground.rasters import RasterSettings
from uavmap.photos.mission_from_photos import derived
from uavmap.photos.picture_replay import judge_pictures
from uavmap.photos.registration.refined_pictures import refined
from uavmap.photos.replay_job import journal_meta
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import Gathered, gather, open_source
from uavmap.photos.sources.photo_file import decoded, read_photo
from uavmap.photos.sources.picture_record import Placed, Refused, credible
from uavmap.photos.workers import Threads, worker_count

SURVEY_PX, SURVEY_ROWS = 320, 240
HEIGHT_M = 40.0
GSD_M = HEIGHT_M * 36.0 / 20.0 / SURVEY_PX  # a focal length of 20 mm on film, 36 mm wide
GROUND_PX = 2048
LEG = 100
LAT_DEG, LON_DEG = 46.84, -91.99
_DEG_M = 111_195.0


def ground(seed: int = 1) -> np.ndarray:
    """Return the patchwork, north up; its edges meet."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 12.0, (GROUND_PX, GROUND_PX, 1)).astype(np.float32)
    noise += cv2.resize(rng.normal(0.0, 14.0, (128, 128)).astype(np.float32), (GROUND_PX,) * 2)[
        ..., None
    ]
    image = np.empty((GROUND_PX, GROUND_PX, 3), np.float32)
    image[:] = (70, 120, 80)
    for start in range(0, GROUND_PX, 512):
        image[:, start + 200 : start + 280] = (165, 160, 160)
    image[900:1000] = (165, 160, 160)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def write_survey(folder: Path, count: int, around: int | None = None) -> None:
    """Write photographs; from number `around` on, over the ground of the first ones."""
    sheet = ground()
    across_m, along_m = 0.5 * SURVEY_ROWS * GSD_M, 0.25 * SURVEY_PX * GSD_M
    rows, columns = np.arange(SURVEY_ROWS), np.arange(SURVEY_PX)
    for number in range(count):
        again, place = divmod(number, around or count)
        leg, step = divmod(place, LEG)
        east_m, north_m = step * along_m + 0.7 * again, leg * across_m + 0.3 * again
        top, left = round(-north_m / GSD_M), round(east_m / GSD_M)
        shot = sheet[np.ix_((rows + top) % GROUND_PX, (columns + left) % GROUND_PX)]
        lat = LAT_DEG + north_m / _DEG_M
        lon = LON_DEG + east_m / _DEG_M / math.cos(math.radians(lat))
        tags = {1: "N", 2: _dms(lat), 3: "W", 4: _dms(-lon)}
        second = 2 * number
        taken = f"2016:06:23 {second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}"
        write_photo(
            folder / f"{number:05}.jpg", gps=tags, taken=taken, image=Image.fromarray(shot),
            xmp=dji(RelativeAltitude=f"+{HEIGHT_M:.2f}", GimbalYawDegree="+0.00"),
        )  # fmt: skip


def _dms(deg: float) -> tuple[float, float, float]:
    whole = int(deg)
    minutes = int((deg - whole) * 60)
    return float(whole), float(minutes), round((deg - whole - minutes / 60) * 3600, 5)


WIDTH_PX = 1000


def mutations(data: bytes, count: int, seed: int = 1) -> Iterator[bytes]:
    """Yield damaged copies of a picture's bytes: bytes changed, parts cut, doubled or swapped."""
    rng = random.Random(seed)
    for number in range(count):
        bad = bytearray(data)
        kind = number % 5
        if kind == 0:
            for _ in range(rng.randint(1, 40)):
                bad[rng.randrange(len(bad))] = rng.randrange(256)
        elif kind == 1:  # the head: tags, tables, sizes
            for _ in range(rng.randint(1, 20)):
                bad[rng.randrange(min(len(bad), 4000))] = rng.choice((0, 0xFF, rng.randrange(256)))
        elif kind == 2:
            del bad[rng.randrange(len(bad)) :]
        elif kind == 3:
            at, length = rng.randrange(len(bad)), rng.randint(1, 20_000)
            del bad[at : at + length]
        else:
            at, length = rng.randrange(len(bad)), rng.randint(1, 20_000)
            bad[at:at] = bad[at : at + length]
        yield bytes(bad)


def survives(data: bytes, path: Path) -> str:
    """Return the outcome of damaged bytes: `tags` refused, `pixels` refused, or `used`."""
    path.write_bytes(data)
    found = read_photo(path, path.name)
    if isinstance(found, Refused):
        return "tags"
    credible([found])
    try:
        decoded(data, WIDTH_PX)
    except ImageError:
        return "pixels"
    return "used"


def seconds_of_passes(gathered: Gathered, detector: Path, workers: int) -> tuple[float, float]:
    """Return wall and CPU seconds of both passes."""
    text = derived(gathered, detector=detector_text(detector))
    setting = setting_of(mission_of_text(text, "derived"))
    begun, used = time.perf_counter(), time.process_time()
    with Spool() as spool:
        judge_pictures(gathered, setting, spool, Threads(workers))
    return time.perf_counter() - begun, time.process_time() - used


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _rate(folder: Path, refine: str, detector: Path) -> None:
    gathered = gather(open_source(folder))
    if refine == "on":  # before the measurement, which is of the replay alone
        better = refined(gathered, None)
        gathered = gathered if better is None else better.gathered
    pictures = [v for v in credible(gathered.pictures) if isinstance(v, Placed)]
    for workers in sorted({1, worker_count()}):
        for _ in range(3):
            begun, used = time.perf_counter(), time.process_time()
            for _ in Threads(workers).in_order(
                lambda p: p.picture.content.decode(WIDTH_PX), pictures
            ):
                pass
            wall, cpu = time.perf_counter() - begun, time.process_time() - used
            ours_wall, ours_cpu = seconds_of_passes(gathered, detector, workers)
            print(
                f"{workers} workers: decoding {wall:.2f} s ({cpu:.2f} s CPU), replay "
                f"{ours_wall:.2f} s ({ours_cpu:.2f} s CPU): {cpu / ours_cpu:.2f} of its rate by CPU"
            )


def _memory(counts: list[int], refine: str, around: int | None) -> None:
    """Print the peak memory of whole replays, each in a process of its own, with all files."""
    print("pictures      s  peak MB  cells  ortho.tif, MB", flush=True)
    with tempfile.TemporaryDirectory() as name:
        for count in counts:
            photographs, out = Path(name) / f"{count}", Path(name) / f"{count}-map"
            photographs.mkdir()
            write_survey(photographs, count, around)
            line = [sys.executable, "-m", "uavmap", "replay", str(photographs), "--refine", refine]
            begun = time.perf_counter()
            process = subprocess.Popen([*line, "--out", str(out)], stdout=subprocess.DEVNULL)
            _, status, used = os.wait4(process.pid, 0)
            summary = json.loads((out / "summary.json").read_text("utf-8"))
            ortho = out / "ortho.tif"
            print(
                f"{count:8} {time.perf_counter() - begun:6.0f} {used.ru_maxrss / 1024:8.0f} "
                f"{summary['cells_seen']:6} {ortho.stat().st_size / 1e6:10.0f}"
                + (f"  exit {os.waitstatus_to_exitcode(status)}" if status else ""),
                flush=True,
            )
            shutil.rmtree(photographs)
            shutil.rmtree(out)


def _results(path: Path, often: int) -> None:
    """Print the seconds from the last verdict to the last result, and of the GeoTIFFs after it."""
    gathered = gather(open_source(path))
    mission = mission_of_text(derived(gathered), "derived")
    for _ in range(often):
        (wall, cpu), (tiff_wall, tiff_cpu) = _result_costs(gathered, mission, str(path))
        print(
            f"results {wall:.2f} s ({cpu:.2f} s CPU), GeoTIFFs {tiff_wall:.1f} s "
            f"({tiff_cpu:.1f} s CPU)",
            flush=True,
        )


def _result_costs(gathered: Gathered, mission: Mission, path: str) -> NDArray[np.float64]:
    """Return wall and CPU seconds (columns) of results and GeoTIFFs (rows) of a replay."""
    with tempfile.TemporaryDirectory() as name, Spool() as spool:
        folder, times = Path(name), []
        judged = judge_pictures(gathered, setting_of(mission), spool)
        times.append((time.perf_counter(), time.process_time()))
        meta = journal_meta(mission, "derived", path) | judged.start_time()
        with Journal.create(folder / JOURNAL, meta) as journal:
            judged.written(journal, folder)
        times.append((time.perf_counter(), time.process_time()))
        judged.write_rasters(folder, RasterSettings())
        times.append((time.perf_counter(), time.process_time()))
    return np.diff(times, axis=0)


def main() -> None:
    """Print the requested figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("rate", "results", "memory"))
    parser.add_argument("path", type=Path, nargs="?")
    parser.add_argument("--pictures", type=int, nargs="+", default=[1000, 3000, 10_000])
    parser.add_argument("--around", type=int)
    parser.add_argument("--refine", choices=("on", "off"), default="off")
    parser.add_argument("--detector", type=Path, default=Path("paved"))
    options = parser.parse_args()
    if options.what == "memory":
        _memory(options.pictures, options.refine, options.around)
    elif options.path is None:
        parser.error(f"{options.what} needs pictures")
    elif options.what == "rate":
        _rate(options.path, options.refine, options.detector)
    else:
        _results(options.path, 5)


if __name__ == "__main__":
    main()
