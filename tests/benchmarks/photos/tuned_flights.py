"""Simulated flights with a tuned detector over ground with fields that look like the region.

    python -m tests.benchmarks.photos.tuned_flights [--seeds 1 2 3]     two minutes a seed

A worn runway on a meadow is painted on three photographs of its western half, taken by the camera
of the flight. Then the two are painted that `uavmap tune` asks for. `uavmap fly --sim` maps the
site from the same height with the learned detector. Bare and ploughed soil, roofs and a yard in the
eastern half look like the runway. `beside` is the share of the cells outside of the region that
were called region; `frames` measures the exploration.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomlkit

from missions.geo.geodesy import LocalPlane
from sitl.camera.pinhole import Shot
from sitl.camera.render import render
from tests.benchmarks.frame import options_of
from tests.benchmarks.photos.unsure import ASKED, run
from tests.support.ground import sites
from uavmap.load.mission_source import load
from uavmap.photos.tune.selection import Counts
from uavmap.runner.simulation import make_vehicles

HEAD = "seed  all: IoU prec. rec.  sure: IoU  unsure m2  beside  flight s  frames"
PHOTO_HEIGHT_M = sites.PHOTO_M / 2 / 0.70021  # tan(35 deg)


def mission(place: sites.Site, folder: Path, detector: dict[str, Any]) -> Path:
    """Write the mission file of a flight over a site whose picture lies in the folder."""
    plane = LocalPlane(sites.ORIGIN)

    def at(east_m: float, north_m: float) -> list[float]:
        point = plane.to_wgs84(east_m, north_m)
        return [round(point.lat_deg, 8), round(point.lon_deg, 8)]

    def ring(margin_m: float) -> list[list[float]]:
        east, north = sites.WIDTH_M - margin_m, sites.HEIGHT_M - margin_m
        return [
            at(margin_m, margin_m), at(east, margin_m), at(east, north), at(margin_m, north)
        ]  # fmt: skip

    sections = {
        "name": place.name, "strategy": "swath",
        "start": {"position": at(10, 20), "amsl_m": 100.0},
        "search": {"box": ring(14.0), "find": "all"},
        "fence": {"polygon": ring(-40.0)},
        "grid": {"cell_m": 2.0},
        "flight": {"altitude_m": round(PHOTO_HEIGHT_M, 1), "speed_m_s": 6.0},
        "camera": {
            "hfov_deg": 70.0, "width_px": sites.PHOTO_PX[0], "height_px": sites.PHOTO_PX[1],
            "mounting": "gimbal", "interval_s": 0.5, "pixels_per_cell": 30.0,
        },
        "detector": detector,
        "votes": {"frames": 5, "positive": 3},
        "battery": {"capacity_wh": 100.0, "hover_power_w": 300.0},
        "vehicles": [{}],
        "sim": {"world": ["site.png"]},
    }  # fmt: skip
    sites.write_orthophoto(place, folder / "site.png")
    file = folder / "field.toml"
    file.write_text(tomlkit.dumps(sections), "utf-8")
    return file


def photographed(place: sites.Site, seed: int, file: Path) -> list[sites.Shot]:
    """Return photographs in lanes over a site, by the camera of the simulated flight."""
    vehicle = make_vehicles(load(str(file)), seed)[0]
    plane, world, camera = LocalPlane(sites.ORIGIN), vehicle.world, vehicle.spec.camera
    found = []
    for number, one in enumerate(sites.photographed(place, seed)):
        east_m, north_m = world.plane.to_plane(plane.to_wgs84(one.east_m, one.north_m))
        attitude = camera.attitude(0.0, 0.0, one.yaw_rad)
        shot = Shot(east_m, north_m, PHOTO_HEIGHT_M, attitude, one.t_s, number)
        jpeg = np.frombuffer(render(world, camera, shot), np.uint8)
        image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), np.uint8)
        found.append(replace(one, image=image))
    return found


def drill(seed: int, folder: Path) -> str:
    """Paint, learn, fly; return the line of a seed."""
    place = sites.site("runway", seed)
    shots = photographed(place, seed, mission(place, folder, {"name": "later"}))
    photos, masks, out = (folder / name for name in ("photos", "painted", "out"))
    sites.write(shots, photos)
    sites.paint(sites.western(shots), masks)
    for eyes in (folder / "eyes-of-three", folder / "eyes"):
        run("tune", str(photos), "--examples", str(masks), "--out", str(eyes))
        lines = (eyes / "next.txt").read_text("utf-8").splitlines()[:ASKED]
        names = {Path(line.split("\t")[0]).stem for line in lines}
        sites.paint([shot for shot in shots if shot.name in names], masks)
    learned = tomlkit.parse((eyes / "detector.toml").read_text("utf-8"))["detector"].unwrap()
    file = mission(place, folder, learned | {"model": "eyes/model.json"})
    run("fly", str(file), "--sim", "--seed", str(seed), "--out", str(out))
    region, unsure, truth = sites.judged_cells(out, place)
    rows = [Counts.compare(region, truth, known) for known in (unsure | True, ~unsure)]
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    beside = float((region & ~truth).sum() / max(1, (~truth).sum()))
    return (
        f"{seed:4}       {rows[0].iou:.3f}  {rows[0].precision:.2f}  {rows[0].recall:.2f}       "
        f"{rows[1].iou:.3f}  {summary['cells_unsure_m2']:9.0f}  {beside:6.3f}"
        f"  {summary['makespan_s']:8.0f}  {summary['frames_judged']:6}"
    )


def main(seeds: Sequence[int]) -> None:
    """Print a line a seed."""
    print(HEAD)
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            print(drill(seed, Path(folder)), flush=True)


if __name__ == "__main__":
    main(options_of(__doc__, seeds=tuple(range(1, 11))).seeds)
