from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from missions.geo.geodesy import LocalPlane
from missions.geo.terrain import Terrain
from missions.units import GridPoint
from tests.unit.vision.scene import CAMERA, GRID, made_up, passes
from uavmap.photos.registration.refinement import TaggedPicture, refine
from uavmap.photos.sources.photo_file import FileContent
from uavmap.photos.sources.picture_record import Picture
from vision.registration import normal_equations
from vision.registration.ground_plane import (
    UNKNOWNS,
    Cameras,
    Relief,
    moved,
    tilted_axes,
    to_ground,
    to_pixels,
    transfer,
)
from vision.registration.normal_equations import Normal, sigmas
from vision.registration.registering import register
from vision.registration.views import Measured

SIDE_M, STEP_M = 60.0, 2.0
PLANE = LocalPlane(GRID.position(GridPoint(0.0, 0.0)))


def terrain(slope, hill_m):
    """Return ground that rises towards the north-east, with hills 40 m long; 0 at the start."""
    steps = np.arange(-SIDE_M, SIDE_M + 1.0, STEP_M)
    east, north = np.meshgrid(steps, steps)
    heights = slope * (0.6 * east + 0.8 * north)
    heights += hill_m * np.sin(math.tau * east / 40.0) * np.cos(math.tau * north / 50.0)
    return Terrain(-SIDE_M, -SIDE_M, STEP_M, heights)


def relief_of(ground):
    return Relief.from_terrain(ground, 0.0, lambda e, n: GRID.fixed(PLANE.to_wgs84(e, n)))


def views_of_flight(ground, seed):
    """Return shots above the ground by their heights above flat ground."""
    shots = passes(2, 4, 5.0, seed)
    level = ground.at(np.array([[s.east_m, s.north_m] for s in shots]))
    return [replace(s, height_m=s.height_m + h) for s, h in zip(shots, level, strict=True)]


def with_ground(views, ground):
    return [
        replace(v, ground_m=float(ground.at(np.array([[v.east_m, v.north_m]]))[0])) for v in views
    ]


def test_a_ray_meets_the_ground_where_it_is():
    ground = relief_of(terrain(0.25, 0.5))
    cameras = Cameras(
        np.array([[3.0, -4.0, 15.0]]), np.array([tilted_axes(0.7, (0.2, -0.1))]),
        np.array([CAMERA.focal_px]), np.array([0]), ground,
    )  # fmt: skip
    pixels = np.random.default_rng(1).uniform(-100, 100, (20, 2))
    views = np.zeros(20, int)
    places = to_ground(cameras, views, pixels)
    assert to_pixels(cameras, views, places) == pytest.approx(pixels, abs=0.01)


def test_pictures_over_hills_agree_on_them():
    """Positions alone err by 0.6 m; on a plane the same pictures agree less or not at all."""
    ground = relief_of(terrain(0.1, 1.0))
    shots = views_of_flight(ground, 1)
    views = with_ground(made_up(shots, 2, relief=ground), ground)
    found, flat = register(views, relief=ground), register(views)
    assert all(pose is not None for pose in found.refined)
    assert found.after is not None
    assert found.after.median_px < 1.0
    assert flat.after is None or flat.after.median_px > 1.5 * found.after.median_px
    high = np.array([p.centre_m[2] for p in found.refined if p]) - [s.height_m for s in shots]
    assert np.abs(high).max() < 1.1  # a tenth: the scale of the set is that of its geotags
    assert np.ptp(high) < 0.8
    tilts = []
    for pose, shot in zip(found.refined, shots, strict=True):
        assert pose is not None
        tilts.append(math.acos(min(1.0, float(pose.axes[:, 2] @ shot.axes()[:, 2]))))
    assert math.degrees(float(np.median(tilts))) < 3.0


def test_poses_over_a_slope_come_back_above_the_start():
    ground = terrain(0.25, 0.0)
    relief = relief_of(ground)
    shots = views_of_flight(relief, 3)
    views = made_up(shots, 4, relief=relief)
    taken = []
    for view, shot in zip(views, shots, strict=True):
        picture = Picture(
            view.name, FileContent(Path("none"), 0), CAMERA.width_px, CAMERA.height_px,
            position=PLANE.to_wgs84(view.east_m, view.north_m), position_sigma_m=1.0,
            height_m=Measured(shot.height_m, 0.5),
        )  # fmt: skip
        taken.append(TaggedPicture(picture, view.features, CAMERA.hfov_rad, 0.03))
    _, found = refine(taken, (GRID, ground))
    assert len(found) == len(shots)
    off = []
    for view, shot in zip(views, shots, strict=True):
        pose = found[view.name].pose
        east_m, north_m = PLANE.to_plane(pose.position)
        off.append([east_m - shot.east_m, north_m - shot.north_m, pose.height_m - shot.height_m])
    assert np.abs(np.median(off, axis=0))[:2].max() < 0.5
    assert np.abs(off).max() < 1.2  # up a tenth: the scale of the set is that of its geotags


def random_system(views, seed):
    """Return normal equations of random rows, and the same as one dense matrix."""
    rng = np.random.default_rng(seed)
    pairs = np.array([(i, j) for i in range(views) for j in range(i + 1, min(i + 3, views))])
    n, shared = UNKNOWNS * views, 3
    dense = np.zeros((n + shared, n + shared))
    for i, j in pairs:
        rows = rng.normal(0.0, 1.0, (20, 2 * UNKNOWNS + shared))
        at = np.r_[UNKNOWNS * i : UNKNOWNS * (i + 1), UNKNOWNS * j : UNKNOWNS * (j + 1), n : n + 3]
        dense[np.ix_(at, at)] += rows.T @ rows
    normal = Normal.zeros(views, pairs, shared)
    for k in range(views):
        own = slice(UNKNOWNS * k, UNKNOWNS * (k + 1))
        normal.diagonal[k], normal.border[k] = dense[own, own], dense[own, n:]
    for at, (i, j) in enumerate(pairs):
        normal.across[at] = dense[
            UNKNOWNS * i : UNKNOWNS * (i + 1), UNKNOWNS * j : UNKNOWNS * (j + 1)
        ]
    normal.corner[:] = dense[n:, n:]
    normal.right[:], normal.right_shared[:] = rng.normal(0.0, 1.0, (views, UNKNOWNS)), 1.0
    return normal, dense


def test_the_sparse_equations_are_solved():
    normal, dense = random_system(9, seed=1)
    x, shared = normal.solve()
    wanted = np.linalg.solve(dense, np.concatenate([normal.right.ravel(), normal.right_shared]))
    assert np.concatenate([x.ravel(), shared]) == pytest.approx(wanted, abs=1e-6)


def test_uncertainties_are_those_of_the_whole_system():
    normal, dense = random_system(9, seed=2)
    wanted = np.sqrt(np.diag(np.linalg.inv(dense)))[: 9 * UNKNOWNS]
    assert sigmas(normal).ravel() == pytest.approx(wanted, rel=1e-9)


def test_uncertainties_of_a_large_net_are_those_beside_the_views_around(
    monkeypatch,
):
    normal, _ = random_system(40, seed=3)
    whole = sigmas(normal)
    monkeypatch.setattr(normal_equations, "MAX_EXACT_VIEWS", 10)
    found = sigmas(normal)
    assert (found <= whole * (1.0 + 1e-9)).all()
    assert found[20] == pytest.approx(whole[20], rel=0.3)


@pytest.mark.parametrize("slope", [None, 0.3])
def test_derivatives_of_a_transfer_are_those_of_differences(slope):
    axes = np.array([tilted_axes(0.3, (0.1, -0.05)), tilted_axes(-2.0, (0.02, 0.15))])
    centre = np.array([[0.0, 0.0, 40.0], [10.0, 5.0, 42.0]])
    relief = None if slope is None else relief_of(terrain(slope, 0.0))
    cameras = Cameras(centre, axes, np.array([500.0, 520.0]), np.array([0, 1]), relief)
    pixels = np.random.default_rng(1).uniform(-200, 200, (5, 2))
    source, target = np.zeros(5, int), np.ones(5, int)
    there = transfer(cameras, source, target, pixels)
    small = 1e-5 if slope is None else 1e-4

    def slopes(step, focal):
        ahead, behind = (
            transfer(moved(cameras, way * step, way * focal), source, target, pixels).pixels
            for way in (small, -small)
        )
        within = {"abs": 1e-5} if slope is None else {"rel": 2e-3, "abs": 0.05}
        return pytest.approx((ahead - behind) / (2 * small), **within)

    for view, by_view in ((0, there.by_source), (1, there.by_target)):
        for k in range(UNKNOWNS):
            step = np.zeros((2, UNKNOWNS))
            step[view, k] = 1.0
            assert by_view[:, :, k] == slopes(step, np.zeros(2))
    for group, by_focal in ((0, there.by_source_focal), (1, there.pixels)):
        assert by_focal == slopes(np.zeros((2, UNKNOWNS)), np.eye(2)[group])
