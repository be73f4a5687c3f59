"""Navigation of a vehicle: reports of its filter and its receiver, and their consequences."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import MissionFileError
from missions.events import Event, Navigated
from missions.geo.grid import Grid
from missions.mission.schema import Mission, NavigationSection
from missions.units import GridPoint
from tests.support.small_missions import CELL_M, START, mission_text, parse_mission, square
from uavmap.aircraft.map_navigation import (
    LOST_S,
    MAX_UNKNOWN_POSITION_S,
    REPORT_INTERVAL_S,
    SATELLITES_BACK_S,
    Navigation,
)
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.vehicle_view import EKF_ABSOLUTE, EKF_CONSTANT, EKF_RELATIVE, VehicleView

GOOD = EKF_ABSOLUTE | EKF_RELATIVE
LOST = EKF_RELATIVE


@dataclass
class Craft:
    mission: Mission
    view: VehicleView = field(default_factory=VehicleView)
    now_s: float = 0.0
    events: list[Event] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    acts: list[tuple[str, str]] = field(default_factory=list)
    fails: list[str] = field(default_factory=list)

    def __post_init__(self):
        clock, grid = lambda: self.now_s, Grid.at(START, CELL_M)
        reporter = Reporter(
            1, "one", self.view, 60.0, grid, clock, clock, operator=self.told.append
        )
        reporter.report = self.events.append
        self.reporter = reporter
        self.navigation = Navigation(reporter, self.mission)
        self.navigation.act = lambda action, reason: self.acts.append((action, reason))
        self.navigation.fail = self.fails.append
        self.view.ekf_flags = GOOD
        self.at(0.0, 0.0)

    def at(self, east_m, north_m):
        self.view.reported = self.reporter.grid.position(GridPoint(east_m, north_m))
        self.view.position = self.view.corrected(self.view.reported)

    def pass_s(self, seconds, *, airborne=True):
        for _ in range(round(10 * seconds)):
            self.now_s = round(self.now_s + 0.1, 3)
            self.navigation.check(airborne=airborne)


def craft(**navigation):
    text = mission_text(square(10, 10, 40, 40), square(-20, -20, 90, 90))
    made = parse_mission(text, "test.toml")
    section = NavigationSection.model_validate(navigation)
    return Craft(made.model_copy(update={"navigation": section}))


def gnss(craft):
    return [event.gnss for event in craft.events if isinstance(event, Navigated)]


@pytest.mark.parametrize("action", ["rtl", "land"])
def test_satellites_lost_end_the_flight_as_the_mission_requires(action):
    flown = craft(gnss_loss=action)
    flown.pass_s(5.0)
    assert not flown.acts
    flown.view.ekf_flags = LOST
    flown.pass_s(LOST_S - 0.2)
    assert not flown.acts  # a flag that flickers is no loss
    flown.pass_s(1.0)
    assert flown.acts == [(action, "satellite navigation is lost")]
    assert gnss(flown) == ["lost"]


def test_flag_that_flickers_restarts_the_wait():
    flown = craft()
    for _ in range(5):
        flown.view.ekf_flags = LOST
        flown.pass_s(LOST_S - 0.3)
        flown.view.ekf_flags = GOOD
        flown.pass_s(0.2)
    assert not flown.acts
    assert not flown.events


@pytest.mark.parametrize(
    ("loss", "fields", "airborne"),
    [
        # constant position mode of a filter is left to its autopilot
        ("map", {"ekf_flags": EKF_RELATIVE | EKF_CONSTANT}, True),
        ("rtl", {"ekf_flags": LOST}, False),
        ("rtl", {"gps_fix": 1}, True),  # the filter may have another receiver
    ],
    ids=["a filter that holds still", "on the ground", "a receiver alone"],
)
def test_flag_without_a_loss_changes_nothing(loss, fields, airborne):
    flown = craft(gnss_loss=loss)
    for name, value in fields.items():
        setattr(flown.view, name, value)
    flown.pass_s(20.0, airborne=airborne)
    assert not flown.acts
    assert not flown.events


def test_receiver_without_a_fix_counts_before_the_filter():
    flown = craft(gnss_loss="map")
    assert mav.MAVLINK_MSG_ID_GPS_RAW_INT in flown.navigation.streams
    flown.view.gps_fix = 1
    flown.pass_s(LOST_S + 0.2)
    assert gnss(flown) == ["lost"]
    flown.view.gps_fix = 3
    flown.pass_s(SATELLITES_BACK_S - 0.5)
    assert flown.navigation.gnss == "lost"
    flown.pass_s(1.0)
    assert flown.navigation.gnss == "good"
    assert gnss(flown)[-1] == "good"


def test_navigation_without_pictures_loses_accuracy_and_returns():
    flown = craft(gnss_loss="map")
    flown.view.ekf_flags = LOST
    flown.pass_s(LOST_S + 0.2)
    sigmas = []
    for metres in range(0, 600, 5):
        flown.at(float(metres % 40), float(metres // 40))
        flown.pass_s(1.0)
        sigmas.append(flown.navigation.sigma_m)
    assert len(flown.fails) == 1
    assert "its own map gives its position" in flown.fails[0]
    told = [event for event in flown.events if isinstance(event, Navigated)]
    gaps = [b.t_s - a.t_s for a, b in itertools.pairwise(told)]
    assert all(gap >= REPORT_INTERVAL_S - 0.2 for gap in gaps)
    assert flown.now_s > MAX_UNKNOWN_POSITION_S


@pytest.mark.parametrize("asked", ['gnss_loss = "map"', "watch = true"])
def test_navigation_by_map_over_a_drifting_region_is_refused(asked):
    text = mission_text(square(10, 10, 40, 40), square(-20, -20, 90, 90), drift_m_s=0.3)
    parse_mission(text, "film.toml")
    with pytest.raises(MissionFileError, match=f"navigation.{asked} does not go with drift"):
        parse_mission(f"{text}\n[navigation]\n{asked}\n", "film.toml")
