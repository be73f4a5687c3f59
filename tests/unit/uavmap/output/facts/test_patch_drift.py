"""The drift of each patch: measured by shares of cells, against outlines that truly move."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import FrameSeen, Vote
from missions.geo.grid import Grid
from missions.units import Cell, LatLon
from tests.support.fleet_rig import field_text
from tests.support.plans import plan_of
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.output.facts.patch_drift import MIN_SPAN_S, Drift, Shares
from uavmap.runner import simulation
from uavmap.runner.flight import fly
from uavmap.ui.cli.common import report

CELL_M = 10.0
GRID = Grid.at(LatLon(48.0, 11.0), CELL_M, drift_speed_m_s=0.3, drift_toward_deg=70.0)
FINE = 6
"""Number of observation points per cell, in each direction."""


@dataclass(frozen=True)
class Blob:
    """A ragged round patch that moves through the cells."""

    east_m: float
    north_m: float
    radius_m: float
    v_east_m_s: float = 0.0
    v_north_m_s: float = 0.0
    grows_m_s: float = 0.0

    def shares(self, cells, t_s):
        fine = (np.arange(FINE) + 0.5) / FINE - 0.5
        east_m = (cells[:, 0, None, None] + fine[:, None]) * CELL_M
        north_m = (cells[:, 1, None, None] + fine) * CELL_M
        east_m, north_m = np.broadcast_arrays(
            east_m - self.east_m - self.v_east_m_s * t_s,
            north_m - self.north_m - self.v_north_m_s * t_s,
        )
        rim_m = self.radius_m * (1.0 + 0.15 * np.sin(3.0 * np.arctan2(north_m, east_m)))
        inside = np.hypot(east_m, north_m) < rim_m + self.grows_m_s * t_s
        return inside.mean(axis=(1, 2))

    def cells(self):
        reach = math.ceil(self.radius_m * 1.3 / CELL_M) + 6
        at = round(self.east_m / CELL_M), round(self.north_m / CELL_M)
        return np.argwhere(np.ones((2 * reach + 1,) * 2)) + at - [reach, reach]


def frames_of(blobs, times_s, *, noise=0.02, lag=0.2, seed=1):
    """Return frames of all cells around each time, columns to the east `lag` seconds later."""
    chance = np.random.default_rng(seed)
    cells = np.unique(np.vstack([blob.cells() for blob in blobs]), axis=0)
    found = []
    for begin_s, k, column in product(times_s, range(3), np.unique(cells[:, 0]).tolist()):
        t_s = round(begin_s + k + lag * (column + 40), 3)
        there = cells[cells[:, 0] == column]
        shares = np.max([blob.shares(there, t_s) for blob in blobs], axis=0)
        shares = np.clip(shares + chance.normal(0.0, noise, len(there)), 0.0, 1.0).round(3)
        pairs = zip(there.tolist(), shares.tolist(), strict=True)
        votes = tuple(Vote(Cell(*cell), share > 0.3, share) for cell, share in pairs)
        found.append(FrameSeen(1, t_s, None, votes))
    return found


def patch(blob):
    cells = blob.cells()
    return {Cell(*cell) for cell in cells[blob.shares(cells, 0.0) > 0.5].tolist()}


def measured(blobs, frames):
    shares = Shares()
    for frame in frames:
        shares.note(frame)
    return shares.drifts_of([patch(blob) for blob in blobs], GRID)


def off_m_s(drift, blob):
    return math.hypot(
        drift.east_m_s - GRID.drift_east_m_s - blob.v_east_m_s,
        drift.north_m_s - GRID.drift_north_m_s - blob.v_north_m_s,
    )


speeds = st.floats(-0.08, 0.08)


@settings(max_examples=8, deadline=None)
@given(speeds, speeds, st.integers(0, 1000))
def test_drift_of_a_patch_is_found_within_its_error(v_east_m_s, v_north_m_s, seed):
    blob = Blob(3.0, -4.0, 60.0, v_east_m_s, v_north_m_s)
    (found,) = measured([blob], frames_of([blob], [0.0, 240.0], seed=seed))
    assert found is not None
    assert found.error_m_s < 0.015
    assert off_m_s(found, blob) < 3.0 * found.error_m_s
    if math.hypot(v_east_m_s, v_north_m_s) > 6.0 * found.error_m_s:
        assert found.differs
    if math.hypot(v_east_m_s, v_north_m_s) < 1e-3:
        assert not found.differs


def test_drift_of_two_patches_is_separate_and_spreading_is_no_drift():
    blobs = [Blob(0.0, 0.0, 70.0, 0.06, 0.02), Blob(260.0, 40.0, 50.0, -0.05, 0.03)]
    for drift, blob in zip(measured(blobs, frames_of(blobs, [0.0, 260.0])), blobs, strict=True):
        assert drift is not None
        assert off_m_s(drift, blob) < 2.0 * drift.error_m_s
        assert drift.differs
    oil = Blob(0.0, 0.0, 70.0, grows_m_s=0.04)
    (found,) = measured([oil], frames_of([oil], [0.0, 240.0]))
    assert found is not None
    assert not found.differs


@pytest.mark.parametrize(
    "frames",
    [
        lambda: [],
        lambda: frames_of([Blob(0.0, 0.0, 60.0)], [0.0], lag=0.0),
        lambda: frames_of([Blob(0.0, 0.0, 60.0)], [0.0, MIN_SPAN_S - 10.0], lag=0.0),
        lambda: frames_of([Blob(0.0, 0.0, 60.0, 0.4)], [0.0, 240.0]),
    ],
    ids=["nothing seen", "seen once", "seen for too short", "moved too far"],
)
def test_drift_that_cannot_be_measured_is_not_reported(frames):
    assert measured([Blob(0.0, 0.0, 60.0)], frames()) == [None]


def test_drift_does_not_depend_on_the_order_of_frames():
    blob = Blob(0.0, 0.0, 60.0, 0.03)
    frames = frames_of([blob], [0.0, 200.0])
    mixed = random.Random(3).sample(frames, len(frames))
    assert measured([blob], frames) == measured([blob], mixed)


def test_drift_is_reported_with_a_true_bearing():
    drift = Drift(GRID.drift_east_m_s, GRID.drift_north_m_s, 0.004, 0.0)
    assert drift.figures(GRID) == {
        "speed_m_s": 0.3, "toward_deg": 70.0, "error_m_s": 0.004, "off_m_s": 0.0, "differs": False,
    }  # fmt: skip


# --- in flight ---------------------------------------------------------------------------------
def test_drift_unlike_that_of_the_mission_is_reported(tmp_path, monkeypatch, capsys):
    truly = simulation.setup_of

    def drifting(*args, **kwargs):
        return replace(truly(*args, **kwargs), drift_speed_m_s=0.06, drift_toward_deg=30.0)

    monkeypatch.setattr(simulation, "setup_of", drifting)
    plan = plan_of(
        "film", field_text(1, high=True), None, None, 1, (), None, SIM_EPOCH_UTC_S
    )  # fmt: skip
    told = fly(plan, tmp_path)
    drift = told["patches"][0]["drift"]
    toward = math.radians(drift["toward_deg"] - 30.0)
    off = math.hypot(drift["speed_m_s"] * math.cos(toward) - 0.06, math.sin(toward) * 0.06)
    assert off < 3.0 * drift["error_m_s"]
    assert drift["differs"]
    report(told, tmp_path, as_json=False)
    assert "set drift.speed_m_s = 0.0" in " ".join(capsys.readouterr().out.split())
