"""The mosaic of a flight: its rate, its seams, and its cost for the flight.

    python -m tests.benchmarks.mosaic [--seeds 1 2 3]

Seams are the offsets between neighbouring squares of 8 m, relative to the ground as the simulator
paints it. Receivers there have an error of 0.3 m on each axis, and attitudes have theirs.
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
from missions.flight.state import Setting
from missions.units import GridPoint
from tests.benchmarks.frame import flight_of, head, options_of, row, spread
from tests.support.ground.true_ground import seams_m, shifts_m, true_ground
from tests.support.plans import named_text, plan_of
from tests.unit.vision.scene import nadir_pose
from uavmap.aircraft.imaging.classifier import PictureJudge, PosedPicture
from uavmap.base.image_files import decoded
from uavmap.journal.kept_frames import KeptFrame
from uavmap.mavlink.session import Session
from uavmap.output.drawing.mosaic_file import Ground
from uavmap.output.results import flown_of
from uavmap.runner.operator.flight_mosaic import FlightMosaic
from uavmap.runner.vehicles import judge_of
from vision.growing_mosaic import GrowingMosaic

PICTURES = 200
STEP_M = 4.0
HEIGHT_M = 12.0
SIZE_PX = 1000, 750


def pictures(setting: Setting) -> Iterator[KeptFrame]:
    """Return pictures in lanes, all of them of new ground."""
    for number in range(PICTURES):
        lane, along = divmod(number, 40)
        place = GridPoint(STEP_M * along, 10.0 * lane)
        pose, _ = nadir_pose(setting.grid, place, HEIGHT_M, 0.0)
        yield KeptFrame("", 1, float(number), pose, 80.0)


def jpeg_of() -> bytes:
    noise = np.random.default_rng(1).integers(0, 255, (188, 250, 3)).astype(np.uint8)
    return cv2.imencode(".jpg", cv2.resize(noise, SIZE_PX))[1].tobytes()


def rate(setting: Setting, jpeg: bytes) -> None:
    """Add pictures to the mosaic on one core, as fast as possible."""
    cv2.setNumThreads(1)
    for kind, picture in (("JPEG", jpeg), ("pixels", decoded(jpeg, ""))):
        with tempfile.TemporaryDirectory() as folder:
            mosaic = FlightMosaic(Path(folder), setting, waits=True)
            begin_s = time.process_time()
            for kept in pictures(setting):
                mosaic.keep(kept, picture)
            mosaic.end()
            spent_s = time.process_time() - begin_s
        print(f"{kind}: {PICTURES / spent_s:.0f} pictures a second of one core")
    cv2.setNumThreads(-1)


def delay(setting: Setting, jpeg: bytes) -> None:
    """Judge 20 pictures a second, with the mosaic beside it and without, in turn."""
    print(head("20 pictures a second", "processor, of one core", "picture to verdict, ms"))
    for _ in range(3):
        for name in ("with", "without"):
            with tempfile.TemporaryDirectory() as folder:
                mosaic = FlightMosaic(Path(folder), setting, waits=False)
                judge = judge_of(setting, [mosaic] if name == "with" else [])
                begin_s, spent_s, found = time.monotonic(), time.process_time(), []
                for number, kept in enumerate(pictures(setting)):
                    time.sleep(max(0.0, begin_s + number / 20.0 - time.monotonic()))
                    at_s = time.perf_counter()
                    taken = PosedPicture(1, kept.t_s, kept.pose, None, True, "picture", jpeg)
                    judge.verdict(taken)
                    found.append(1e3 * (time.perf_counter() - at_s))
                share = (time.process_time() - spent_s) / (time.monotonic() - begin_s)
                mosaic.end()
            print(row(name, f"{share:.1%}", spread(found)), flush=True)


def seams(seeds: list[int]) -> None:
    print(head("flight", "seed", "seams, m", "below 0.5 m", "off the true ground, m"))
    for strategy in ("swath", "survey"):
        for seed in seeds:
            for name, how in (
                ("", GrowingMosaic.aligned),
                (", as the poses say", lambda _, o, *__: o),
            ):
                with (
                    mock.patch.object(GrowingMosaic, "aligned", how),
                    flight_of("runway", strategy=strategy, seed=seed) as (_, folder),
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
def orders_timed(clock: Callable[[], float] = time.perf_counter) -> Iterator[list[float]]:
    """Record the time from a picture to the next order in the context, ms."""
    found, begun = list[float](), [float("inf")]
    judge, send = PictureJudge.verdict, Session.send

    def judged(self: PictureJudge, taken: Any) -> Any:
        begun[0] = clock()
        return judge(self, taken)

    def sent(self: Session, message: Any) -> None:
        send(self, message)
        if message.get_type() == "COMMAND_INT" and begun[0] < float("inf"):
            found.append(1e3 * (clock() - begun[0]))
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
                flight_of("tests/data/tiny.toml", strategy="rdfs", seed=seed),
            ):
                pass
            print(row(name, f"{time.process_time() - begin_s:.2f}", spread(orders)), flush=True)


if __name__ == "__main__":
    options = options_of(__doc__, seeds=(1, 2, 3))
    text = named_text("runway").text.replace("width_px = 640", f"width_px = {SIZE_PX[0]}")
    text = text.replace("height_px = 480", f"height_px = {SIZE_PX[1]}")
    parts = setting_of(plan_of("runway", text).mission), jpeg_of()
    rate(*parts)
    delay(*parts)
    cost(options.seeds)
    seams(options.seeds)
