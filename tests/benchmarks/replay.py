"""How fast a replay is beside the decoder, how much memory it takes, and what damage does to it.

python -m tests.benchmarks.replay rate FOLDER          pictures a second, beside decoding alone
python -m tests.benchmarks.replay memory PICTURE 10000 the same ground, so often, other bytes
python -m tests.benchmarks.replay fuzz PICTURE 1000    damaged copies: no crash, no memory
"""

from __future__ import annotations

import argparse
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from missions.errors import ImageError
from missions.state import Setting
from missions.units import LatLon
from uavmap.fly.progress import Silent
from uavmap.mission_source import MissionSource
from uavmap.offline.credible import Placed, credible
from uavmap.offline.derived import derived
from uavmap.offline.gathering import Gathered, gather
from uavmap.offline.replay import Options, look_at_all
from uavmap.offline.sources.opening import open_source
from uavmap.offline.sources.photo_file import decoded, read_photo
from uavmap.offline.sources.record import Picture, Refused
from uavmap.offline.spool import Spool
from uavmap.offline.workers import Threads, in_order, worker_count

WIDTH_PX = 1000


def mutations(data: bytes, count: int, seed: int = 1) -> Iterator[bytes]:
    """Copies of a picture's bytes with damage: bytes changed, parts cut, doubled or swapped."""
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
    """What becomes of damaged bytes: `tags` refused, `pixels` refused, or `used`."""
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


@dataclass(frozen=True, slots=True)
class Varied:
    """The content of a file, said to be another each time."""

    inner: Picture
    number: int

    @property
    def size_bytes(self) -> int:
        return self.number

    def digest(self) -> str:
        return str(self.number)

    def decode(self, max_width_px: int):
        image = self.inner.content.decode(max_width_px).copy()
        image[0, :3] = [[self.number >> 16 & 255, self.number >> 8 & 255, self.number & 255]]
        return image


def many(picture: Picture, count: int) -> Gathered:
    """A survey of legs of 50 pictures, of one picture again and again."""
    assert picture.position is not None
    pictures = []
    for number in range(count):
        leg, step = divmod(number, 50)
        place = LatLon(
            picture.position.lat_deg + step * 1e-4, picture.position.lon_deg + leg * 2.5e-4
        )
        content = Varied(picture, number)
        name = f"{number:05}.jpg"
        pictures.append(
            replace(picture, name=name, content=content, position=place, taken_s=float(number))
        )
    return Gathered("copies", tuple(pictures), (), 0, ())


def looked(gathered: Gathered, workers: int) -> tuple[float, float]:
    """Wall and CPU seconds of both passes."""
    setting = Setting.of(MissionSource("derived", derived(gathered)).parse())
    begun, used = time.perf_counter(), time.process_time()
    with Spool() as spool:
        look_at_all(gathered, setting, spool, Silent(), Options(Threads(workers)))
    return time.perf_counter() - begun, time.process_time() - used


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _rate(folder: Path) -> None:
    gathered = gather(open_source(folder))
    pictures = [v for v in credible(gathered.pictures) if isinstance(v, Placed)]
    for workers in sorted({1, worker_count()}):
        for _ in range(3):
            begun, used = time.perf_counter(), time.process_time()
            for _ in in_order(lambda p: p.picture.decode(WIDTH_PX), pictures, workers):
                pass
            wall, cpu = time.perf_counter() - begun, time.process_time() - used
            ours_wall, ours_cpu = looked(gathered, workers)
            print(
                f"{workers} workers: decoding {wall:.2f} s ({cpu:.2f} s CPU), replay "
                f"{ours_wall:.2f} s ({ours_cpu:.2f} s CPU): {cpu / ours_cpu:.2f} of its rate by CPU"
            )


def _memory(path: Path, most: int) -> None:
    picture = read_photo(path, path.name)
    assert isinstance(picture, Picture)
    for count in (most // 100, most // 10, most):
        wall, _ = looked(many(picture, count), worker_count())
        print(f"{count} pictures: {wall:.0f} s, peak {peak_mb():.0f} MB", flush=True)


def fuzz_pictures(path: Path, count: int) -> None:
    """Print what becomes of damaged copies, and the memory that it took."""
    data, outcomes = path.read_bytes(), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for bad in mutations(data, count):
            outcomes[survives(bad, Path(folder) / "bad.jpg")] += 1
    print(f"{count} mutations: {dict(outcomes)}, peak {peak_mb():.0f} MB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("rate", "memory", "fuzz"))
    parser.add_argument("path", type=Path)
    parser.add_argument("count", type=int, nargs="?", default=1000)
    options = parser.parse_args()
    if options.what == "rate":
        _rate(options.path)
    elif options.what == "memory":
        _memory(options.path, options.count)
    else:
        fuzz_pictures(options.path, options.count)
    return 0


if __name__ == "__main__":
    sys.exit(main())
