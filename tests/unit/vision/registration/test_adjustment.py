"""The equations under a registration: derivatives, sparse solutions, uncertainties."""

from __future__ import annotations

import numpy as np
import pytest

from tests.unit.vision.registration.test_relief import relief_of, terrain
from vision.registration import normal_equations
from vision.registration.ground_plane import UNKNOWNS, Cameras, moved, tilted_axes, transfer
from vision.registration.normal_equations import Normal, sigmas


def random_system(views: int, seed: int) -> tuple[Normal, np.ndarray]:
    """Normal equations of made-up rows, and the same as one dense matrix."""
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


def test_the_sparse_equations_are_solved() -> None:
    normal, dense = random_system(9, seed=1)
    x, shared = normal.solve()
    wanted = np.linalg.solve(dense, np.concatenate([normal.right.ravel(), normal.right_shared]))
    assert np.concatenate([x.ravel(), shared]) == pytest.approx(wanted, abs=1e-6)


def test_uncertainties_are_those_of_the_whole_system() -> None:
    normal, dense = random_system(9, seed=2)
    wanted = np.sqrt(np.diag(np.linalg.inv(dense)))[: 9 * UNKNOWNS]
    assert sigmas(normal).ravel() == pytest.approx(wanted, rel=1e-9)


def test_of_a_large_net_they_are_those_beside_the_views_around(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    normal, _ = random_system(40, seed=3)
    whole = sigmas(normal)
    monkeypatch.setattr(normal_equations, "MOST_EXACT", 10)
    found = sigmas(normal)
    assert (found <= whole * (1.0 + 1e-9)).all()
    assert found[20] == pytest.approx(whole[20], rel=0.3)


@pytest.mark.parametrize("slope", [None, 0.3])
def test_derivatives_of_a_transfer(slope: float | None) -> None:
    axes = np.array([tilted_axes(0.3, (0.1, -0.05)), tilted_axes(-2.0, (0.02, 0.15))])
    centre = np.array([[0.0, 0.0, 40.0], [10.0, 5.0, 42.0]])
    relief = None if slope is None else relief_of(terrain(slope, 0.0))
    cameras = Cameras(centre, axes, np.array([500.0, 520.0]), np.array([0, 1]), relief)
    pixels = np.random.default_rng(1).uniform(-200, 200, (5, 2))
    source, target = np.zeros(5, int), np.ones(5, int)
    there = transfer(cameras, source, target, pixels)
    small = 1e-5 if slope is None else 1e-4

    def slopes(step: np.ndarray, focal: np.ndarray) -> np.ndarray:
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
    for group, by_focal in ((0, there.by_source_focal), (1, there.by_target_focal)):
        assert by_focal == slopes(np.zeros((2, UNKNOWNS)), np.eye(2)[group])
