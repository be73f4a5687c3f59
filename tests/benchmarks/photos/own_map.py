"""Errors of a vehicle's position by its own pictures; prints a table.

    python -m tests.benchmarks.photos.own_map                 all of it, 20 flights a row
    python -m tests.benchmarks.photos.own_map --flights 3 --rows drift lost

A flight of five minutes over the shipped world `runway`, at 12 m and 6 m/s with five pictures a
second: lanes, and then lanes across them. Its pictures are rendered once; the reported positions
differ from flight to flight.

    undisturbed   alarms, which are false
    drift         satellites wander off by 0.1 m/s from some time on: error when that is noticed
    jump          satellites leap by 5 m: seconds until that is noticed
    lost          dead reckoning with 2 % from some time on for 200 s: error with and without
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.navigation import ReportedErrors
from missions.units import LatLon, Pose
from sitl.body.estimator import PositionError
from sitl.camera.pinhole import Shot
from sitl.camera.render import render
from tests.benchmarks.frame import options_of, spread
from uavmap.load.mission_source import load
from uavmap.runner.simulation import setup_of
from vision.camera import Camera
from vision.own_map.ground_patch import Patch, patch
from vision.own_map.map_position import OwnMap
from vision.projection import Frame

HEIGHT_M, SPEED_M_S, SECONDS = 12.0, 6.0, 300.0
EVERY_S = 0.2
LANE_M, LENGTH_M = 12.0, 100.0
SIGMAS_PER_TOLERATED = 2.0
MIN_ALARM_M = 0.6


@dataclass(frozen=True)
class TruePicture:
    """A picture as the estimate sees it, and its true place."""

    t_s: float
    east_m: float
    north_m: float
    patch: Patch | None


def corners() -> Iterator[tuple[float, float]]:
    """Yield corners of lanes to the north and south, and then across them, for ever."""
    places_m = [k * LANE_M for k in range(int(LENGTH_M // LANE_M))]
    there, back = (0.0, LENGTH_M), (LENGTH_M, 0.0)
    while True:
        for k, place_m in enumerate(places_m):
            yield from ((place_m, end) for end in (back if k % 2 else there))
        for k, place_m in enumerate(places_m):
            yield from ((end, LENGTH_M - place_m) for end in (there if k % 2 else back))


def way(seconds: float, every_s: float) -> Iterator[tuple[float, float, float, float]]:
    """Return time, east, north and heading."""
    ends = corners()
    here, t_s = next(ends), 0.0
    left_m = 0.0
    for there in ends:
        way_m = math.dist(here, there)
        heading = math.atan2(there[0] - here[0], there[1] - here[1])
        along_m = left_m
        while along_m < way_m:
            share = along_m / way_m
            yield (
                t_s,
                here[0] + share * (there[0] - here[0]),
                here[1] + share * (there[1] - here[1]),
                heading,
            )
            t_s += every_s
            if t_s >= seconds:
                return
            along_m += SPEED_M_S * every_s
        left_m, here = along_m - way_m, there


@lru_cache
def flight(
    heading_bias_deg: float, height_bias: float, seed: int, every_s: float = EVERY_S,
    attitude_deg: float = 0.3,
) -> tuple[TruePicture, ...]:  # fmt: skip
    """Return the pictures of a flight; reported heading and height have these errors."""
    mission = load("runway")
    setup = setup_of(mission, seed)
    world = setup.build()[0].world
    rng = np.random.default_rng(seed)
    start = world.plane.to_plane(LatLon(37.19755, -80.57890))
    spec = setup.camera
    camera = Camera(math.radians(spec.hfov_deg), spec.width_px, spec.height_px)
    taken, lean = [], np.zeros(2)
    for k, (t_s, east_m, north_m, heading) in enumerate(way(SECONDS, every_s)):
        lean += 0.2 * (rng.normal(0.0, math.radians(3.0), 2) - lean)
        height_m = HEIGHT_M + 0.2 * math.sin(t_s / 7.0)
        told_lean = lean + rng.normal(0.0, math.radians(attitude_deg), 2)
        told_heading = heading + math.radians(heading_bias_deg)
        told_height_m = height_m * (1.0 + height_bias) + rng.normal(0.0, 0.05)
        attitude = spec.attitude(float(lean[0]), float(lean[1]), heading)
        shot = Shot(east_m + start[0], north_m + start[1], height_m, attitude, t_s, k)
        data = np.frombuffer(render(world, spec, shot), np.uint8)
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
        told = spec.attitude(float(told_lean[0]), float(told_lean[1]), told_heading)
        frame = Frame(image, Pose(LatLon(0.0, 0.0), told_height_m, told), t_s, camera)
        taken.append(TruePicture(t_s, east_m, north_m, patch(frame, metres_per_pixel=0.2)))
    return tuple(taken)


# --- what is told -------------------------------------------------------------------------------
@dataclass(frozen=True)
class Fault:
    """A fault and its time; `kind` is none, drift, jump or lost."""

    kind: str
    begin_s: float
    seed: int
    gps_sigma_m: float


def position_errors(told: Fault, taken: tuple[TruePicture, ...]) -> np.ndarray:
    """Return the error of the reported position at each picture, shape (n, 2)."""
    rng = np.random.default_rng([told.seed, 7])
    noise = PositionError(np.random.default_rng([told.seed, 8]), told.gps_sigma_m, 60.0)
    for _ in range(2000):
        noise.step(0.1)
    bearing = rng.uniform(0.0, math.tau)
    toward = np.array([math.sin(bearing), math.cos(bearing)])
    scale, turn = 0.02 * rng.choice([-1.0, 1.0]), 0.02 * rng.normal()
    errors, before = [], taken[0]
    reckoned: NDArray[np.float64] | None = None
    for shot in taken:
        for _ in range(2):
            noise.step((shot.t_s - before.t_s) / 2.0 if shot is not before else 0.1)
        error = np.array([noise.east, noise.north])
        since_s = shot.t_s - told.begin_s
        if since_s < 0.0 or told.kind == "none":
            pass
        elif told.kind == "drift":
            error += 0.1 * since_s * toward
        elif told.kind == "jump":
            error += 5.0 * toward
        else:
            step = np.array([shot.east_m - before.east_m, shot.north_m - before.north_m])
            across = np.array([-step[1], step[0]])
            wander = rng.normal(0.0, 0.03 * math.sqrt(max(shot.t_s - before.t_s, 0.0)), 2)
            reckoned = error if reckoned is None else reckoned
            error = reckoned = reckoned + scale * step + turn * across + wander
        errors.append(error)
        before = shot
    return np.array(errors)


@dataclass
class Outcome:
    """The outcome of one flight."""

    alarm_s: float | None = None
    alarm_error_m: float = math.nan
    estimate_m: list[float] = field(default_factory=list)
    told_m: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    worst_lead: float = -math.inf


def fly_and_measure(told: Fault, taken: tuple[TruePicture, ...], check_every: int = 5) -> Outcome:
    """Do one flight; it ends at an alarm."""
    errors = position_errors(told, taken)
    own = OwnMap(ReportedErrors(satellites_m=max(0.3, told.gps_sigma_m), pointing_m=0.08))
    tolerated_m = max(MIN_ALARM_M, SIGMAS_PER_TOLERATED * told.gps_sigma_m)
    out = Outcome()
    for k, (shot, error) in enumerate(zip(taken, errors, strict=True)):
        trusted = not (told.kind == "lost" and shot.t_s >= told.begin_s)
        if told.kind == "lost" and shot.t_s >= told.begin_s + 200.0:
            break
        place = (shot.east_m + error[0], shot.north_m + error[1])
        begin = time.process_time()
        estimate = own.add_picture(shot.t_s, shot.patch, place, trusted)
        out.ms.append(1e3 * (time.process_time() - begin))
        off = np.array(estimate.error_m) - error
        out.estimate_m.append(float(np.hypot(*off)))
        out.told_m.append(float(np.hypot(*error)))
        out.nees.append(float(off @ off) / estimate.sigma_m**2 / 2.0)
        if told.kind != "lost" and k % check_every == 0:
            said = own.disagreement()
            out.worst_lead = max(out.worst_lead, said.least_m - tolerated_m)
            if said.wrong(tolerated_m):
                out.alarm_s, out.alarm_error_m = shot.t_s, float(np.hypot(*error))
                break
    return out


def _row(kind: str, sigma_m: float, bias: float, height: float, flights: int) -> str:
    taken = flight(bias, height, 1)
    begin = time.perf_counter()
    outs = []
    for seed in range(flights):
        latest_s = 95.0 if kind == "lost" else 240.0
        begin_s = float(np.random.default_rng([seed, 9]).uniform(40.0, latest_s))
        outs.append((begin_s, fly_and_measure(Fault(kind, begin_s, seed, sigma_m), taken)))
    took_s = time.perf_counter() - begin
    told = {"none": _undisturbed, "lost": _lost}.get(kind, _lied)
    cost = f"; ms {spread(np.concatenate([o.ms for _, o in outs]))} ({took_s:.0f} s)"
    return f"{kind:6s} {sigma_m:4.1f} {bias:3.0f} {height:5.2f}  " + told(outs) + cost


def _undisturbed(outs: list[tuple[float, Outcome]]) -> str:
    alarms = sum(o.alarm_s is not None for _, o in outs)
    nees = np.mean(np.concatenate([o.nees for _, o in outs]))
    rms, told = (
        np.sqrt(np.mean(np.square(np.concatenate([getattr(o, name) for _, o in outs]))))
        for name in ("estimate_m", "told_m")
    )
    lead = max(o.worst_lead for _, o in outs)
    return f"alarms {alarms}, worst lead {lead:.2f}, rms {rms:.2f} told {told:.2f}, NEES {nees:.2f}"


def _lost(outs: list[tuple[float, Outcome]]) -> str:
    corrected, told, nees = (
        np.concatenate([getattr(o, name)[-999:] for _, o in outs])
        for name in ("estimate_m", "told_m", "nees")
    )
    return f"corrected {spread(corrected)}, told {spread(told)}, NEES {np.mean(nees):.2f}"


def _lied(outs: list[tuple[float, Outcome]]) -> str:
    alarms = [(o.alarm_s - b, o.alarm_error_m) for b, o in outs if o.alarm_s is not None]
    late = [(after_s, off_m) for after_s, off_m in alarms if after_s >= 0.0]
    false = f"false {len(alarms) - len(late)}, found {len(late)}"
    if not late:
        return false
    seconds, off_m = np.array(late).T
    return f"{false}, after {spread(seconds)} s, error there {spread(off_m)} m"


def main() -> None:
    """Print the table."""
    options = options_of(
        __doc__, flights=20, rows=("none", "drift", "jump", "lost"), sigmas=(0.3, 1.5),
        biases=(0.0, 2.0),
    )  # fmt: skip
    for kind, sigma, bias in itertools.product(options.rows, options.sigmas, options.biases):
        print(_row(kind, sigma, bias, 0.02 if bias else 0.0, options.flights), flush=True)


if __name__ == "__main__":
    main()
