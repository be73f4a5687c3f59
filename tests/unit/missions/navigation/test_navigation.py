"""The error of external positions by links: honest, and robust against wrong links."""

from __future__ import annotations

import math

import numpy as np
import pytest

from missions.navigation import ReportedErrors, Track

ERRORS = ReportedErrors(satellites_m=1.0, satellites_s=30.0, pointing_m=1e-3)
SIGMA_M = 0.05


class Flight:
    """A flight back and forth along a line, with a keyframe a second and honest errors."""

    def __init__(self, seed: int, seconds: int = 80, errors: ReportedErrors = ERRORS) -> None:
        self.rng = np.random.default_rng(seed)
        self.true = [complex(0.0, 4.0 * abs((k + 10) % 20 - 10)) for k in range(seconds)]
        self.common = complex(*self.rng.normal(0.0, errors.common, 2))
        keep = math.exp(-1.0 / errors.satellites_s)
        error, self.off = self._normal(errors.satellites_m), []
        for _ in self.true:
            self.off.append(error)
            error = keep * error + self._normal(errors.satellites_m * math.sqrt(1 - keep**2))
        self.track = Track(errors)

    def _normal(self, sigma: float) -> complex:
        return complex(*self.rng.normal(0.0, sigma, 2))

    def moved(self, i: int, j: int) -> tuple[float, float]:
        """Return a vector as the ground shows it, with common scale and rotation, and noise."""
        # to the first order a link's own path is longer by `common` of its vector
        seen = (self.true[j] - self.true[i]) / (1.0 - self.common) + self._normal(SIGMA_M)
        return seen.real, seen.imag

    def add(self, k: int, trusted: bool = True, off: complex | None = None) -> int:
        reported = self.true[k] + (self.off[k] if off is None else off)
        return self.track.add(float(k), (reported.real, reported.imag), trusted)

    def run(self, until: int) -> None:
        for k in range(until):
            self.add(k)
            for i in {k - 1, k - 2, k - 20, k - 40} & set(range(k)):
                self.track.link(i, k, self.moved(i, k), SIGMA_M)


def test_estimated_error_is_honest():
    squares, common = [], []
    for seed in range(60):
        flight = Flight(seed, 50)
        flight.run(50)
        estimated = flight.track.estimate()
        off = complex(*estimated.error_m) - flight.off[-1]
        squares.append(abs(off) ** 2 / estimated.sigma_m**2)
        common.append(abs(complex(estimated.scale, estimated.rotation_rad) - flight.common))
    # 120 degrees of freedom: 95 % of such sums lie between these
    assert 91.6 < sum(squares) < 152.2
    assert np.mean(common) < 0.75 * math.sqrt(math.pi / 2) * ERRORS.common


def test_heights_that_wander_are_followed_by_zooms():
    """Scale and rotation are a process; two pictures of the ground show their change."""
    squares, turned = [], []
    errors = ReportedErrors(satellites_m=0.5, pointing_m=1e-3, common_s=60.0)
    for seed in range(15):
        flight = Flight(seed, 100, errors)
        keep = math.exp(-1.0 / errors.common_s)
        turns = [flight.common]
        for _ in range(99):
            turns.append(keep * turns[-1] + flight._normal(errors.common * math.sqrt(1 - keep**2)))
        for k in range(100):
            flight.add(k)
            for i in {k - 1, k - 2, k - 20, k - 40} & set(range(k)):
                flight.common = (turns[i] + turns[k]) / 2.0
                zoom = turns[k] - turns[i] + flight._normal(0.003)
                flight.track.link(i, k, flight.moved(i, k), SIGMA_M, (zoom, 0.003))
        estimated = flight.track.estimate()
        squares.append(
            abs(complex(*estimated.error_m) - flight.off[-1]) ** 2 / estimated.sigma_m**2
        )
        turned.append(abs(complex(estimated.scale, estimated.rotation_rad) - turns[-1]))
    # 30 degrees of freedom: 95 % of such sums lie between these
    assert 16.8 < sum(squares) < 47.0
    assert np.mean(turned) < 0.5 * math.sqrt(math.pi / 2) * errors.common


@pytest.mark.parametrize("sigma_m", [0.3, 0.9])
def test_error_of_satellites_is_learned(sigma_m):
    learned = []
    for seed in range(4):
        flight = Flight(seed, 150, ReportedErrors(satellites_m=sigma_m, satellites_s=60.0))
        flight.track = Track(ReportedErrors(satellites_m=1.0, satellites_s=60.0))
        flight.run(150)
        flight.track.estimate()
        learned.append(flight.track.satellites_m)
    assert 0.7 * sigma_m < np.mean(learned) < 1.5 * sigma_m


def test_navigation_without_satellites_holds_on_to_the_map_made_before():
    flight = Flight(3)
    flight.run(40)
    before = flight.track.estimate()
    reckoned = flight.off[39]
    for k in range(40, 80):
        reckoned += 0.03 * (flight.true[k] - flight.true[k - 1]) + 0.15
        flight.add(k, trusted=False, off=reckoned)
        for i in (k - 1, k - 40):
            flight.track.link(i, k, flight.moved(i, k), SIGMA_M)
    estimated = flight.track.estimate()
    assert abs(reckoned) > 5.0
    assert abs(complex(*estimated.error_m) - reckoned) < 3.0 * estimated.sigma_m
    assert estimated.sigma_m < before.sigma_m + 0.3


def test_satellites_that_drift_disagree():
    errors = ReportedErrors(satellites_m=0.3, pointing_m=1e-3)
    flight = Flight(4, errors=errors)
    reported = []
    for k in range(80):
        flight.add(k, off=flight.off[k] + 0.1 * max(0, k - 40))
        for i in {k - 1, k - 20, k - 40} & set(range(k)):
            flight.track.link(i, k, flight.moved(i, k), SIGMA_M)
        reported.append(flight.track.disagreement())
    assert all(d.least_m < 0.6 for d in reported[:42])
    alarm = next(k for k, d in enumerate(reported) if d.least_m > 0.6)
    assert alarm - 40 < 25
    assert 25.0 < reported[alarm].since_s < 48.0
    flight.track.distrust(reported[alarm].since_s)
    estimated = flight.track.estimate()
    assert abs(complex(*estimated.error_m) - flight.off[79] - 3.9) < 3.0 * estimated.sigma_m
    assert estimated.sigma_m < 0.6


def test_a_leap_is_believed_when_two_links_show_it():
    flight = Flight(5, errors=ReportedErrors(satellites_m=0.3))
    flight.run(41)
    flight.add(41, off=flight.off[41] + 6.0)
    flight.track.link(40, 41, flight.moved(40, 41), SIGMA_M)
    assert flight.track.disagreement().least_m < 1.0  # one may be wrong
    flight.track.link(21, 41, flight.moved(21, 41), SIGMA_M)
    estimated = flight.track.disagreement()
    assert estimated.least_m > 3.0
    assert math.dist(estimated.error_m, (6.0, 0.0)) < 1.5


@pytest.mark.parametrize("late", [False, True])
def test_wrong_link_does_not_carry_the_position_off(late):
    flight = Flight(6)
    flight.run(60)
    flight.add(60)
    if late:
        for i in (59, 40):
            flight.track.link(i, 60, flight.moved(i, 60), SIGMA_M)
        flight.track.estimate()
    before, links = flight.track.estimate(), flight.track.links
    east, north = flight.moved(20, 60)
    flight.track.link(20, 60, (east + 4.0, north - 3.0), SIGMA_M)
    after = flight.track.estimate()
    assert after.error_m == pytest.approx(before.error_m, abs=1e-9)
    assert flight.track.links == links


def test_neighbours_of_a_removed_keyframe_stay_tied():
    flight = Flight(7)
    flight.run(60)
    before = flight.track.estimate()
    for number in range(1, 40, 2):
        flight.track.remove(number)
    after = flight.track.estimate()
    assert len(flight.track.numbers) == 40
    assert math.dist(before.error_m, after.error_m) < 0.5
    assert after.sigma_m == pytest.approx(before.sigma_m, rel=0.3)


def test_unknown_keyframe_or_link_is_refused():
    track = Track()
    with pytest.raises(ValueError, match="without keyframes"):
        track.estimate()
    a = track.add(1.0, (0.0, 0.0), True)
    with pytest.raises(ValueError, match="after one at 1 s"):
        track.add(1.0, (0.0, 0.0), True)
    with pytest.raises(ValueError, match="no link"):
        track.link(a, a, (0.0, 0.0), 0.1)
    with pytest.raises(ValueError, match="satellites_m"):
        ReportedErrors(satellites_m=0.0)
