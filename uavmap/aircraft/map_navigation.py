"""The position of one vehicle when satellites give none, or a false one.

    frame -> own map -> error of the reported position -> view.off_deg

The map that a vehicle makes gives its position (`vision.own_map.map_position`): each picture is
compared with those before it. While satellites are good that only shows whether they are. When they
are lost, or found to be false, it corrects the position that the autopilot reports, and every
target (`uavmap.mavlink.vehicle_view`). So other code needs to know nothing of this: fence, energy,
separation and votes hold for the true position.

`navigation.gnss_loss` is the mission's choice. An autopilot that lands or returns by a failsafe of
its own has priority, as always.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError
from missions.events import Navigated
from missions.guardian import Action
from missions.mission.schema import Mission
from missions.navigation import Estimate
from missions.planning.sweep.strategies import LEAPFROG
from missions.units import GridPoint, LatLon
from uavmap.aircraft.reporter import Reporter
from vision.own_map.ground_patch import patch, resolution_m
from vision.own_map.map_position import OwnMap
from vision.projection import Frame

if TYPE_CHECKING:
    from uavmap.aircraft.leapfrog_sight import Member

Gnss = Literal["good", "lost", "wrong"]

SAME_SCALE: Final = 1.5
"""Maximum ratio of heights at which a picture is matched with the map."""
LOST_S: Final = 1.5
"""Time for which a filter reports no position on Earth before it counts as lost, s."""
LEAP_S: Final = 2.0
"""Time that a navigation filter takes to show a jump of its satellites, s."""
SATELLITES_BACK_S: Final = 5.0
"""Time after which satellites that are back are used again, s."""
COMPARE_S: Final = 0.5
"""Interval between two comparisons of satellites and pictures, s."""
AGREE_S: Final = 30.0
"""Time for which satellites that were false must agree with the pictures, s."""
AGREE_M: Final = 1.0
REPORT_INTERVAL_S: Final = 5.0
"""Interval between two events while satellites are not used, s."""
MAX_UNKNOWN_POSITION_S: Final = 10.0
"""Time for which a vehicle's position may be unknown before it is sent home, s."""
UNSEEN_S: Final = 1.0
"""Time without a picture after which the position becomes less certain with the distance, s."""
AID_EVERY_S: Final = 2.0
AID_M: Final = 0.3
"""Error from which on the autopilot is sent its position, m."""


class Navigation:
    """The navigation of one vehicle.

    `act` has its guardian return or land, `fail` reports that it cannot continue. `aid` sends the
    autopilot its position with a standard deviation.
    """

    def __init__(self, reporter: Reporter, mission: Mission) -> None:
        self._reporter = reporter
        self._view = reporter.view
        self._wanted = mission.navigation
        self._altitude_m = mission.altitude_m(reporter.number - 1)
        self._metres_per_pixel = resolution_m(mission.camera.optics, self._altitude_m)
        """Resolution of the compared ground, m per pixel: pictures are from all heights."""
        self._most_m = 0.5 * mission.grid.cell_m
        """Standard deviation of a position beyond which it decides on no cell, m."""
        self._own = OwnMap() if mission.navigation.watches else None
        self._pair = mission.strategy == LEAPFROG.name
        self.partner: Member | None = None
        """In a leapfrog: the measurements of both."""
        self.gnss: Gnss = "good"
        self.sigma_m = 0.0
        """Standard deviation of the corrected position, m."""
        self.act: Callable[[Action, str], None] = lambda action, reason: None
        self.fail: Callable[[str], None] = lambda reason: None
        self.aid: Callable[[LatLon, float], None] = lambda place, sigma_m: None
        self._off = GridPoint(0.0, 0.0)
        self._since_s: float | None = None
        """Time since which the filter reports otherwise than `gnss`, s."""
        self._agrees_s: float | None = None
        self._pictured_s = float("-inf")
        self._flown_m = 0.0
        self._last: GridPoint | None = None
        self._unsure_s: float | None = None
        self._taken_s = self._compared_s = float("-inf")
        self._reported_s = self._aided_s = float("-inf")
        self._failed = False

    @property
    def streams(self) -> Mapping[int, float]:
        """Rates, Hz, by message id, that it needs besides a mission's."""
        rates = {mav.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0} if self.watches else {}
        return {**rates, mav.MAVLINK_MSG_ID_ATTITUDE: 10.0} if self._pair else rates

    @property
    def watches(self) -> bool:
        """True if pictures are needed wherever it flies."""
        return self._own is not None or self._pair

    @property
    def watches_at_rest(self) -> bool:
        """True if pictures are needed while it waits as well."""
        return self.partner is not None

    @property
    def _by_partner(self) -> bool:
        """True if it uses sightings when satellites are lost."""
        return self.partner is not None and self._wanted.gnss_loss == "leapfrog"

    @property
    def by_map(self) -> bool:
        """True if positions are corrected by pictures: its own, or its partner's."""
        return self.gnss != "good" and (self._own is not None or self._by_partner)

    # --- what its filter says ------------------------------------------------------------------
    def check(self, *, airborne: bool) -> None:
        """Check the telemetry; call it with every position."""
        if self._view.position is None:
            return
        now_s = self._reporter.now_s()
        if not airborne:
            self._start_at_home(now_s)
            return
        self._add_distance()
        lost = self._view.by_dead_reckoning or self._goes_on_without_fix
        if lost == (self.gnss == "lost") or self.gnss == "wrong":
            self._since_s = None
        else:
            self._since_s = now_s if self._since_s is None else self._since_s
            if now_s - self._since_s >= (LOST_S if lost else SATELLITES_BACK_S):
                self._change_gnss("lost" if lost else "good", now_s)
        self._exchange_with_partner(now_s)
        if self.gnss != "good":
            self._check_certainty(now_s)

    def _exchange_with_partner(self, now_s: float) -> None:
        """Share this position with the partner, and use the measurements of both."""
        if self.partner is None or self._view.reported is None:
            return
        reported = self._reporter.grid.fixed(self._view.reported)
        good = self._view.by_satellites and not self._view.has_no_fix
        self.partner.add_move(reported, now_s, good=good)
        if self.gnss == "lost" and self._by_partner:
            self._correct(self.partner.off)
            self.sigma_m = self.partner.sigma_m

    @property
    def _goes_on_without_fix(self) -> bool:
        """Return whether the receiver has no fix.

        It is reason enough for pictures, but not to return or to land: the filter may have another
        receiver.
        """
        return self._view.has_no_fix and self._wanted.gnss_loss in ("map", "leapfrog")

    def leapt(self, how: str) -> bool:
        """Note that the reported position jumped; return False if no pictures show the true one."""
        if self._own is None:
            return False
        if self.gnss == "good":
            now_s = self._reporter.now_s()
            self._own.track.distrust(now_s - LEAP_S)
            self._reporter.line(f"vehicle {self._reporter.number}: {how}")
            self._change_gnss("wrong", now_s)
        return True

    def _start_at_home(self, now_s: float) -> None:
        """Take its home for its place; satellites that were false are not used again."""
        self._last, self._since_s, self._unsure_s = None, None, None
        if self.gnss == "lost" and not self._view.by_dead_reckoning:
            self._change_gnss("good", now_s)
        if self.gnss == "wrong" and not self._failed:
            self._failed = True
            self.fail("its satellite navigation has given a wrong position")

    def _add_distance(self) -> None:
        here = self._reporter.position()
        if self._last is not None:
            self._flown_m += here.distance_to(self._last)
        self._last = here

    def _change_gnss(self, gnss: Gnss, now_s: float) -> None:
        before, self.gnss = self.gnss, gnss
        self._since_s = self._unsure_s = self._agrees_s = None
        number = self._reporter.number
        if gnss == "good":
            if before == "wrong" and self._own is not None:
                self._own.track.trust_again()
            self._correct(GridPoint(0.0, 0.0))
            self._reporter.line(f"vehicle {number}: satellite navigation is back")
        else:
            what = "is lost" if gnss == "lost" else "gives a wrong position"
            how_on = self._source_text(before)
            self._reporter.line(f"vehicle {number}: satellite navigation {what}{how_on}")
        self._report(now_s)
        if gnss == "lost" and before == "good" and self._wanted.gnss_loss in ("rtl", "land"):
            self.act(self._wanted.gnss_loss, "satellite navigation is lost")
        elif gnss == "wrong" and self._wanted.gnss_loss == "land":
            self.act("land", "satellite navigation gives a wrong position")
        elif gnss == "wrong" and self._wanted.gnss_loss == "rtl":
            # its autopilot would return to the wrong place
            self.fail("satellite navigation gives a wrong position")

    def _source_text(self, before: Gnss) -> str:
        if self._wanted.gnss_loss == "map" and before == "good":
            return f"; it continues by its own map, to ±{self.sigma_m:.1f} m"
        if self._by_partner and before == "good":
            return "; it continues by mutual sightings"
        return ""

    def _report(self, now_s: float) -> None:
        self._reported_s = now_s
        if not self.by_map:
            self._reporter.report_now(Navigated, self.gnss)
            return
        off = GridPoint(round(self._off.east_m, 2), round(self._off.north_m, 2))
        self._reporter.report_now(Navigated, self.gnss, sigma_m=round(self.sigma_m, 2), off_m=off)

    # --- what its pictures say -----------------------------------------------------------------
    def add_frame(self, frame: Frame) -> Frame:
        """Return a frame with the pose by the vehicle's pictures.

        Raises `ImageError` if it is not known well enough to decide on a cell.
        """
        if self.partner is not None:
            self.partner.add_frame(frame)
        if self._own is None and not self._by_partner:
            return frame
        now_s = self._reporter.now_s()
        reported = self._reporter.grid.fixed(frame.pose.position)
        # a late one does not show the present state
        if self._own is not None and frame.t_s > self._taken_s:
            self._taken_s = frame.t_s
            up_rad = self._reporter.grid.convergence_rad
            low = frame.pose.height_m <= SAME_SCALE * self._altitude_m
            metres = self._metres_per_pixel if low else None
            ground = patch(frame, metres_per_pixel=metres, up_rad=up_rad)
            trusted = self.gnss == "good" and self._view.by_satellites
            trusted = trusted and not self._view.has_no_fix
            known = self._own.add_picture(
                frame.t_s, ground, (reported.east_m, reported.north_m), trusted
            )
            self._pictured_s, self._flown_m = now_s, 0.0
            self._learn(known, now_s)
        if self.gnss == "good":
            return frame
        if self.sigma_m > self._most_m:
            raise ImageError(f"its place is known to ±{self.sigma_m:.1f} m only")
        place = GridPoint(reported.east_m - self._off.east_m, reported.north_m - self._off.north_m)
        position = self._reporter.grid.position(place)
        return replace(frame, pose=replace(frame.pose, position=position))

    def _learn(self, known: Estimate, now_s: float) -> None:
        if self.gnss != "good":
            self._use(known)
            self._check_satellites(now_s)
            return
        self.sigma_m = known.sigma_m
        if self._own is None or now_s - self._compared_s < COMPARE_S:
            return
        self._compared_s = now_s
        found = self._own.track.disagreement()
        if found.wrong(self._wanted.tolerated_m):
            self._own.track.distrust(found.since_s)
            self._use(self._own.track.estimate())
            self._change_gnss("wrong", now_s)

    def _use(self, known: Estimate) -> None:
        self._correct(GridPoint(*known.error_m))
        self.sigma_m = known.sigma_m
        if self.gnss == "lost":
            self._aid()

    def _correct(self, off: GridPoint) -> None:
        """Correct the reported place by `off`, along the grid's axes, from now on."""
        self._off = off
        grid, reported = self._reporter.grid, self._view.reported
        if reported is None:
            return
        there = grid.fixed(reported)
        true = grid.position(GridPoint(there.east_m - off.east_m, there.north_m - off.north_m))
        self._view.off_deg = (reported.lat_deg - true.lat_deg, reported.lon_deg - true.lon_deg)
        self._view.position = true
        self._last = None

    def _check_satellites(self, now_s: float) -> None:
        """Use satellites that were false again once they have long agreed."""
        if self.gnss != "wrong":
            return
        agrees = math.hypot(*self._off) + self.sigma_m < AGREE_M
        if not agrees:
            self._agrees_s = None
            return
        self._agrees_s = now_s if self._agrees_s is None else self._agrees_s
        if now_s - self._agrees_s >= AGREE_S:
            self._change_gnss("good", now_s)

    def _check_certainty(self, now_s: float) -> None:
        """Estimate the certainty without pictures; a vehicle that knows too little returns."""
        if self._own is not None and now_s - self._pictured_s > UNSEEN_S:
            known_m = self._own.track.estimate().sigma_m if self._own.keyframes else math.inf
            self.sigma_m = math.hypot(known_m, self._own.errors.reckoned_share * self._flown_m)
        if now_s - self._reported_s >= REPORT_INTERVAL_S:
            self._report(now_s)
        if self._wanted.gnss_loss not in ("map", "leapfrog") or self._failed:
            return
        if self.sigma_m <= self._most_m:
            self._unsure_s = None
            return
        self._unsure_s = now_s if self._unsure_s is None else self._unsure_s
        if now_s - self._unsure_s >= MAX_UNKNOWN_POSITION_S:
            self._failed = True
            what = "mutual sightings" if self._by_partner else "its own map"
            self.fail(f"{what} gives its position to ±{self.sigma_m:.0f} m only")

    def _aid(self) -> None:
        """Send the autopilot its position if it has lost its satellites and knows less."""
        now_s = self._reporter.now_s()
        off_m = math.hypot(*self._off)
        if now_s - self._aided_s < AID_EVERY_S or off_m < max(AID_M, self.sigma_m):
            return
        self._aided_s = now_s
        if self._view.position is not None:
            self.aid(self._view.position, self.sigma_m)
