"""The mosaic of a flight: its rate, its seams, and what it costs the flight.

    python -m tests.benchmarks.mosaic [--seeds 1 2 3]

Seams are by how much neighbouring squares of 8 m are off against each other, held against the
ground as the simulator paints it; receivers there have an error of 0.3 m on each axis, attitudes
have theirs.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np

from missions.flight.setting_of import setting_of
from missions.units import GridPoint
from tests.benchmarks.frame import asked, flown, head, row, spread
from tests.support.plans import named_text, plan_of
from tests.support.true_ground import seams_m, shifts_m, true_ground
from tests.unit.vision.scene import nadir_pose
from uavmap.aircraft.imaging.classifier import PictureJudge
from uavmap.journal.kept_frames import KeptFrame
from uavmap.mavlink.session import Session
from uavmap.output.drawing.mosaic_file import Ground
from uavmap.output.results import flown_of
from uavmap.runner.operator.flight_mosaic import FlightMosaic
from vision.mosaic import Mosaic

PICTURES = 200
STEP_M = 4.0
HEIGHT_M = 12.0


def rate() -> None:
    """Lay pictures of 1000 x 750 in lanes, all of them new ground, on one core."""
    cv2.setNumThreads(1)
    setting = setting_of(plan_of("runway", named_text("runway").text).mission)
    noise = np.random.default_rng(1).integers(0, 255, (188, 250, 3)).astype(np.uint8)
    jpeg = cv2.imencode(".jpg", cv2.resize(noise, (1000, 750)))[1].tobytes()
    for kind, picture in (("JPEG", jpeg), ("pixels", cv2.resize(noise, (1000, 750)))):
        with tempfile.TemporaryDirectory() as folder:
            mosaic = FlightMosaic(Path(folder), setting, waits=True)
            begin_s = time.process_time()
            for number in range(PICTURES):
                lane, along = divmod(number, 40)
                place = GridPoint(STEP_M * along, 10.0 * lane)
                pose, _ = nadir_pose(setting.grid, place, HEIGHT_M, 0.0)
                mosaic.keep(KeptFrame("", 1, float(number), pose, 80.0), picture)
            mosaic.end()
            spent_s = time.process_time() - begin_s
        print(f"{kind}: {PICTURES / spent_s:.0f} pictures a second of one core")
    cv2.setNumThreads(-1)


def seams(seeds: list[int]) -> None:
    print(head("flight", "seed", "seams, m", "below 0.5 m", "off the true ground, m"))
    for strategy in ("swath", "survey"):
        for seed in seeds:
            for name, how in (("", Mosaic.aligned), (", as the poses say", lambda _, o, *__: o)):
                with (
                    mock.patch.object(Mosaic, "aligned", how),
                    flown("runway", strategy=strategy, seed=seed) as (_, folder),
                ):
                    setting = flown_of(folder).setting
                    ground = Ground.read(folder, setting.grid)
                assert ground is not None
                truth = true_ground(setting, seed, ground.raster)
                off = shifts_m(ground.image, truth, ground.raster.pitch_m)
                found, lengths = seams_m(off), np.hypot(*off[np.isfinite(off[..., 0])].T)
                share = f"{np.mean(found < 0.5):.0%}"
                print(row(strategy + name, seed, spread(found), share, spread(lengths)), flush=True)


@contextmanager
def orders_timed() -> Iterator[list[float]]:
    """Meanwhile the time from a picture to the order that follows it is noted, ms."""
    found, begun = list[float](), [float("inf")]
    judge, send = PictureJudge.verdict, Session.send

    def judged(self: PictureJudge, taken: Any) -> Any:
        begun[0] = time.perf_counter()
        return judge(self, taken)

    def sent(self: Session, message: Any) -> None:
        send(self, message)
        if message.get_type() == "COMMAND_INT" and begun[0] < float("inf"):
            found.append(1e3 * (time.perf_counter() - begun[0]))
            begun[0] = float("inf")

    with (
        mock.patch.object(PictureJudge, "verdict", judged),
        mock.patch.object(Session, "send", sent),
    ):
        yield found


def cost(seeds: list[int]) -> None:
    """Fly with the mosaic and without, in turn; a simulated flight waits for its mosaic."""
    nothing: Callable[..., None] = lambda *_: None  # noqa: E731
    print(head("`tiny`, `rdfs`", "processor time, s", "picture to order, ms"))
    for seed in seeds:
        for name, keep in (("with", FlightMosaic.keep), ("without", nothing)):
            begin_s = time.process_time()
            with (
                mock.patch.object(FlightMosaic, "keep", keep),
                orders_timed() as orders,
                flown("tests/data/tiny.toml", strategy="rdfs", seed=seed),
            ):
                pass
            print(row(name, f"{time.process_time() - begin_s:.2f}", spread(orders)), flush=True)


if __name__ == "__main__":
    options = asked(__doc__, seeds=(1, 2, 3))
    rate()
    cost(options.seeds)
    seams(options.seeds)
