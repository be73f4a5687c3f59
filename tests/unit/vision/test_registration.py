"""Poses from overlaps: rendered pictures, and artificial features, with known truth."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.unit.vision.scene import (
    HEIGHT_M,
    Shot,
    features_of,
    made_up,
    meadow,
    passes,
    tagged,
    view,
)
from vision.registration.ground_plane import bearing
from vision.registration.matching import candidates, extract
from vision.registration.registering import register
from vision.registration.views import (
    CONTRADICTED,
    NO_HEADING,
    NO_OVERLAP,
    NO_TEXTURE,
    SIDEWAYS,
    Features,
    Registration,
    View,
)

UPSIDE_DOWN, TILTED, TOO_HIGH = 4, 7, 2
ELSEWHERE, WATER = "12", "13"


def hard_flight() -> list[Shot]:
    """Return three passes of four pictures with varying exposure, one turned, one tilted."""
    shots = passes(3, 4, 5.0, seed=1)
    shots[UPSIDE_DOWN] = replace(shots[UPSIDE_DOWN], upside_down=True)
    shots[TILTED] = replace(shots[TILTED], tilt_deg=(35.0, 10.0))
    return shots


SHOTS = hard_flight()


@pytest.fixture(scope="module")
def features() -> list[Features]:
    """Return features of the flight, of a picture of another place, and of water."""
    elsewhere = extract(Shot(2.0, 1.0).picture(meadow(2), 50))
    rng = np.random.default_rng(7)
    ripples = cv2.GaussianBlur(rng.normal(0.0, 1.0, (240, 320)), (0, 0), 40.0)
    water = extract(np.clip(90 + 60 * ripples + rng.normal(0, 1, (240, 320)), 0, 255).astype("u1"))
    return [*features_of(SHOTS, meadow(1)), elsewhere, water]


@pytest.fixture(scope="module")
def bare(features: list[Features]) -> list[View]:
    """Return views with a position that errs by 0.6 m, and no other tag."""
    rng = np.random.default_rng(3)
    shots = [*SHOTS, Shot(2.0, 1.0), Shot(-2.0, 3.0)]
    return [
        view(f"{k:02}", shot, f, rng)
        for k, (shot, f) in enumerate(zip(shots, features, strict=True))
    ]


@pytest.fixture(scope="module")
def found(bare: list[View]) -> Registration:
    """Return the registration by positions alone."""
    return register(bare)


def errors(result: Registration, shots: list[Shot]) -> np.ndarray:
    """Return the errors of each refined view: east, north, up, m, and its bearing, degrees."""
    rows = []
    for pose, shot in zip(result.refined, shots, strict=False):
        assert pose is not None
        slope = np.array(result.nets[pose.component].slope)
        place = pose.centre_m[:2] + pose.centre_m[2] * slope
        yaw = bearing(pose.axes[None])[0] - bearing(shot.axes()[None])[0]
        off = np.array([*(place - (shot.east_m, shot.north_m)), pose.centre_m[2] - shot.height_m])
        rows.append([*off, math.degrees(math.remainder(yaw, math.tau))])
    return np.array(rows)


def test_positions_alone_suffice(found: Registration) -> None:
    """The set as a whole errs as its geotags do; within the set the error is some cm."""
    off = errors(found, SHOTS)
    assert np.abs(off[:, :2].mean(axis=0)).max() < 0.6
    assert np.abs(off[:, 2]).max() < 0.1 * HEIGHT_M  # the scale: 0.6 m of 15 m of flight, 12 times
    assert np.abs(off[:, 3]).max() < 5.0
    # against each other: turned and scaled as a whole they are right
    assert np.ptp(off[:, 2]) < 0.15
    assert np.ptp(off[:, 3]) < 0.3
    assert found.before is None  # nothing to compare with: tags have no pose
    assert found.after is not None
    assert found.after.median_px < 0.6
    assert found.after.most_m < 0.1


def test_angle_of_each_view_against_the_others_is_found(found: Registration) -> None:
    """All attitudes err by one rotation: by the bearing of the set."""
    turns = []
    for pose, shot in zip(found.refined, SHOTS, strict=False):
        assert pose is not None
        turns.append(pose.axes @ shot.axes().T)
    for turn in turns:
        left = turn @ turns[0].T
        assert math.degrees(math.acos(min(1.0, (np.trace(left) - 1.0) / 2.0))) < 0.5


def test_uncertainties_cover_the_errors(found: Registration) -> None:
    off = errors(found, SHOTS)
    for row, pose in zip(off, found.refined, strict=False):
        assert pose is not None
        assert np.abs(row[:2]).max() < 4.0 * pose.position_sigma_m
        assert abs(row[2]) < 4.0 * pose.height_sigma_m
        assert abs(row[3]) < 4.0 * math.degrees(pose.yaw_sigma_rad)


def test_pictures_of_other_ground_are_left_alone_and_named(found: Registration) -> None:
    assert found.left[:12] == (None,) * 12
    assert found.left[12] == NO_OVERLAP
    assert found.left[13] in (NO_TEXTURE, NO_OVERLAP)
    assert found.refined[12] is None
    assert found.refined[13] is None
    assert found.nets[0].members == tuple(range(12))


def test_tags_that_are_wrong_are_found_out(bare: list[View]) -> None:
    """One height tag is a fifth too high, one picture upside down: the others outvote the tags."""
    views = [
        tagged(v, shot, height=1.2 if k == TOO_HIGH else 1.0)
        for k, (v, shot) in enumerate(zip(bare, SHOTS, strict=False))
    ]
    result = register(views)
    off = errors(result, SHOTS)
    assert [p.turned for p in result.refined if p] == [k == UPSIDE_DOWN for k in range(12)]
    assert np.abs(off[:, 2]).max() < 0.07 * HEIGHT_M
    assert np.ptp(off[:, 2]) < 0.15
    assert np.abs(off[:, 3]).max() < 3.0
    assert result.before is not None
    assert result.after is not None
    assert result.before.median_m > 1.0
    assert result.after.most_m < 0.1


def test_the_order_of_the_views_and_the_threads_change_nothing(
    bare: list[View], found: Registration, features: list[Features]
) -> None:
    order = np.random.default_rng(5).permutation(len(bare))
    with ThreadPoolExecutor(3) as pool:
        again = register([bare[k] for k in order], many=pool.map)
    for at, k in enumerate(order):
        one, other = found.refined[k], again.refined[at]
        assert found.left[k] == again.left[at]
        if one is not None:
            assert other is not None
            assert np.array_equal(one.centre_m, other.centre_m)
            assert np.array_equal(one.axes, other.axes)
    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        alone = extract(SHOTS[0].picture(meadow(1), 0))
    finally:
        cv2.setNumThreads(threads)
    assert np.array_equal(alone.points, features[0].points)
    assert np.array_equal(alone.descriptors, features[0].descriptors)


# --- made-up features ---------------------------------------------------------------------------
def test_two_groups_keep_their_geotags() -> None:
    """Two groups 300 m apart, each with an error of its own: neither is drawn to the other."""
    near, far = passes(3, 3, 5.0, seed=2), passes(3, 3, 5.0, seed=3)
    shots = [*near, *(replace(s, east_m=s.east_m + 300.0) for s in far)]
    views = made_up(shots, seed=1)
    result = register(views)
    assert [len(net.members) for net in result.nets] == [9, 9]
    for net in result.nets:
        poses = [result.refined[k] for k in net.members]
        places = np.mean(
            [p.centre_m[:2] + p.centre_m[2] * np.array(net.slope) for p in poses if p], 0
        )
        tags = np.mean([(views[k].east_m, views[k].north_m) for k in net.members], axis=0)
        assert np.abs(places - tags).max() < 0.3


def test_two_pictures_are_too_few_for_a_heading() -> None:
    shots = passes(1, 2, 4.0, seed=4)
    views = made_up(shots, seed=2)
    assert register(views).left == (NO_HEADING, NO_HEADING)
    reported = [tagged(v, s) for v, s in zip(views, shots, strict=True)]
    assert register(reported).left == (None, None)


def test_set_that_is_all_upside_down_is_found_by_its_geotags() -> None:
    shots = [replace(s, upside_down=True) for s in passes(3, 4, 5.0, seed=6)]
    views = [tagged(v, s) for v, s in zip(made_up(shots, seed=3), shots, strict=True)]
    result = register(views)
    assert all(p is not None and p.turned for p in result.refined)


def test_sloping_ground_is_distinguished_from_tilted_cameras() -> None:
    """By the ground all cameras lean one way; their gimbals show that they do not."""
    fall = 0.06  # towards the east
    level = [replace(s, tilt_deg=(0.0, 0.0), height_m=HEIGHT_M) for s in passes(3, 4, 5.0, seed=7)]
    leaning = [
        replace(
            s,
            height_m=HEIGHT_M + fall * s.east_m,
            yaw_deg=90.0,
            tilt_deg=(s.yaw_deg - 90.0, math.degrees(fall)),
        )
        for s in level
    ]
    views = [
        replace(tagged(v, s), east_m=v.east_m + HEIGHT_M * fall)
        for v, s in zip(made_up(leaning, seed=4), level, strict=True)
    ]
    result = register(views)
    assert result.nets[0].slope == pytest.approx((fall, 0.0), abs=0.015)
    # the point on the ground below stays there: the camera is beside it
    assert np.abs(np.array([
        p.centre_m[:2] - (s.east_m, s.north_m)
        for p, s in zip(result.refined, leaning, strict=True) if p
    ]).mean(axis=0)).max() < 0.5  # fmt: skip


def test_pattern_that_comes_again_elsewhere_misleads_no_view() -> None:
    shots = passes(4, 5, 5.0, seed=8)
    result = register(made_up(shots, seed=5, again=((-6.0, -6.0), (7.0, 8.0), 4.0)))
    off = errors(result, shots)
    assert np.ptp(off[:, 2]) < 0.3
    assert np.ptp(off[:, 3]) < 1.0
    assert CONTRADICTED not in result.left


def test_pattern_that_stays_at_its_pixel_is_the_cameras_own() -> None:
    """A stamp or the sensor's pattern would lay all pictures on one another."""
    rng = np.random.default_rng(9)
    points, words = (
        rng.uniform(-150, 150, (200, 2)),
        rng.integers(0, 60, (200, 128)).astype(np.uint8),
    )
    stamp = Features(points, words, 320, 240)
    views = [view(f"{k}", Shot(5.0 * k, 0.0), stamp, rng) for k in range(3)]
    assert register(views).left == (NO_OVERLAP,) * 3


def test_a_picture_that_looks_sideways_is_left_out() -> None:
    shots = passes(3, 3, 5.0, seed=10)
    views = made_up(shots, seed=6)
    views[4] = replace(views[4], tilt=(0.0, 2.0))
    assert register(views).left[4] == SIDEWAYS


def test_registration_of_no_picture_or_one_leaves_all() -> None:
    assert register([]) == Registration((), (), (), None, None)
    assert register(made_up([Shot(0.0, 0.0)], seed=1)).left == (NO_OVERLAP,)


def test_candidates_are_linear_and_cross_the_passes() -> None:
    """Pictures that follow each other closely do not crowd out the neighbouring pass."""
    empty = Features(np.zeros((0, 2)), np.zeros((0, 128), np.uint8), 320, 240)
    rng = np.random.default_rng(0)
    shots = [Shot(20.0 * lane, 1.0 * k) for lane in range(4) for k in range(50)]
    views = [view(f"{k:03}", s, empty, rng) for k, s in enumerate(shots)]
    pairs = candidates(views)
    assert len(pairs) < 16 * len(views)
    for lane in range(3):
        assert sum(i // 50 == lane and j // 50 == lane + 1 for i, j in pairs) > 50


@pytest.mark.parametrize("shape", [(1, 1), (2, 700), (31, 31), (90, 160)])
def test_a_picture_of_one_colour_or_of_a_few_pixels_has_no_features(shape: tuple[int, int]) -> None:
    assert len(extract(np.full(shape, 90, np.uint8)).points) == 0
