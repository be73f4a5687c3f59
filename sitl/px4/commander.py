"""Arming and modes of a PX4: who may change them, and what follows from a change."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from sitl.body.battery import Battery
from sitl.body.estimator import Estimator
from sitl.body.physics import Body
from sitl.copter.aircraft import SEVERITY_INFO, Aircraft
from sitl.copter.failsafes import CHARGE_CRITICAL
from sitl.copter.fence import ALT_MAX, CIRCLE, POLYGON, Fence, names
from sitl.copter.modes import Phase
from sitl.copter.motion import Airframe
from sitl.copter.params import Parameters
from sitl.copter.trajectory import DelayedFollower, px4_speed
from sitl.px4.aiding import Ekf2Aiding
from sitl.px4.failsafes import Px4Failsafes, Setpoints
from sitl.px4.modes import BY_HAND, LEVEL, UNARMABLE, Px4Mode
from sitl.px4.params import TABLE, px4_tuning

# A stream of places and velocities at 10 Hz was followed 0.33 s late (0.12 to 0.73 s, 90 % of the
# time), most in the first seconds of a path
_SETPOINT_DELAY_S, _FIRST_DELAY_S = 0.2, 0.7


class Px4Fence(Fence):
    """Uploaded polygons and circles, GF_MAX_HOR_DIST and GF_MAX_VER_DIST."""

    def enabled(self, parameters: Parameters) -> bool:
        """Whether there is anything to break, and GF_ACTION says that it matters."""
        there = self.zones or parameters["GF_MAX_HOR_DIST"] or parameters["GF_MAX_VER_DIST"]
        return bool(there) and parameters["GF_ACTION"] != 0.0

    def floor_m(self, parameters: Parameters) -> float:
        """There is none."""
        return -math.inf

    def _limits(self, parameters: Parameters) -> tuple[int, float, float, float]:
        """Distances that are not positive are none."""
        farthest = (parameters[name] for name in ("GF_MAX_VER_DIST", "GF_MAX_HOR_DIST"))
        high_m, far_m = (limit_m if limit_m > 0.0 else math.inf for limit_m in farthest)
        return ALT_MAX | CIRCLE | POLYGON, -math.inf, high_m, far_m


LASTS_S = 120.0
EVERY_S = 2.0


class HomeCorrection:
    """By how much the height of home is off, as a seed has it.

    >>> home = HomeCorrection([1], most_m=1.5)
    >>> home.height_m(1.9)
    0.0
    >>> home.height_m(2.0) == home.height_m(3.9) != home.height_m(4.0)
    True
    >>> abs(home.height_m(500.0)) <= 1.5
    True
    """

    def __init__(self, seed: Sequence[int], most_m: float) -> None:
        rng = np.random.default_rng(list(seed))
        count = int(LASTS_S / EVERY_S)
        drawn = rng.standard_normal(count) * (0.5 * most_m)
        self._heights_m: list[float] = [0.0, *np.clip(drawn, -most_m, most_m).tolist()]

    def height_m(self, flown_s: float) -> float:
        """The error so long after take-off."""
        at = min(int(flown_s / EVERY_S + 1e-9), len(self._heights_m) - 1)
        return self._heights_m[max(at, 0)]


Wish = tuple[float | None, float | None, float | None]
"""East, north, up; None where it is left open."""


class Commander(Aircraft):
    """Whether a PX4 arms, and which mode it is in."""

    mode: Px4Mode
    failsafes: Px4Failsafes

    def __init__(
        self,
        body: Body,
        error: Estimator,
        battery: Battery,
        airframe: Airframe,
        *,
        system_id: int,
        correction: HomeCorrection,
    ) -> None:
        parameters = Parameters(TABLE)
        aiding = Ekf2Aiding(body, error, parameters)
        super().__init__(
            body,
            error,
            battery,
            airframe,
            parameters,
            Px4Fence(),
            aiding,
            tune=px4_tuning,
            speed_law=px4_speed,
            follower=DelayedFollower(_SETPOINT_DELAY_S, _FIRST_DELAY_S),
            first_item=0,
        )
        parameters.preset("BAT1_CAPACITY", battery.capacity_mah)
        parameters.preset("MAV_SYS_ID", system_id)
        self.mode = Px4Mode.HOLD
        self.failsafes = Px4Failsafes()
        self.sources = aiding
        self.setpoints = Setpoints()
        self.correction = correction
        self._flies_since_s: float | None = None
        self._home_up = 0.0  # of home when it took off
        self._after_disarming = self._intended = Px4Mode.HOLD
        self._take_off_to: Wish = (None, None, None)  # asked for with NAV_TAKEOFF
        self._has_flown = False  # since it was armed
        self._climbs_first = False  # a mission that does not begin with a take-off
        self._hangs = False  # its return has nowhere to go
        self._complains_s = 0.0

    # --- what it knows of itself ---------------------------------------------------------------

    @property
    def intended(self) -> Px4Mode:
        """The mode that somebody asked for, whatever a failsafe does meanwhile."""
        return self._intended if self.failsafes.engaged else self.mode

    @property
    def in_mission(self) -> bool:
        """AUTO.MISSION."""
        return self.mode == Px4Mode.MISSION

    @property
    def position_lost(self) -> bool:
        """Nothing helps, or the filter's own accuracy has passed COM_POS_FS_EPH."""
        return self.error.unaided or self.position_poor

    @property
    def position_poor(self) -> bool:
        """The position by optical flow has become worse than COM_POS_FS_EPH; below 0: never."""
        if self.sources.absolute or not self.error.flow:
            return False
        limit_m = self.parameters["COM_POS_FS_EPH"]
        return 0.0 <= limit_m < self.error.accuracy_m

    @property
    def prearm_ok(self) -> bool:
        """The prearm bit of SYS_STATUS: the checks pass."""
        return self.prearm_refusal() is None

    def prearm_refusal(self) -> str | None:
        """What the checks before arming object to, or None."""
        if self.body.crashed:
            return "Preflight Fail: crash detected"
        if not self.position_ok:
            return "Preflight Fail: no global position"
        if self.parameters["NAV_DLL_ACT"] > 0.0 and not self.failsafes.hears_station(
            self.t_s, self.parameters
        ):
            return "Preflight Fail: No connection to the ground control station"
        if self.battery.empty or self.failsafes.charge_state >= CHARGE_CRITICAL:
            return "Preflight Fail: low battery"
        if self.mode == Px4Mode.OFFBOARD and not self.setpoints.fresh(self.t_s):
            return "Preflight Fail: no offboard signal"
        now = self.estimate
        here = (now.east, now.north, now.up)
        if broken := self.fence.violations(self.parameters, here, here):
            return f"Preflight Fail: outside the geofence ({names(broken)})"
        return None

    # --- arming ---------------------------------------------------------------------------------

    def arm(self, force: bool = False) -> str | None:
        """Start the motors; in Takeoff and Mission it takes off with that."""
        if self.armed:
            return None
        if self.body.crashed or self.battery.empty:
            return f"Arming denied! {self.prearm_refusal()}"
        if not force:
            refusal = self.prearm_refusal() or self._mode_refusal(self.mode)
            if refusal is not None:
                return f"Arming denied! {refusal}"
            if self.mode in UNARMABLE:
                return f"Arming denied! Mode {self.mode.name} prevents arming"
        self._has_flown = False
        self._start_motors("Armed by external command")
        self._begin_mode()
        return None

    def disarm(self, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, and then it falls."""
        if not self.armed:
            return None
        if self.airborne and not force:
            return "Disarming denied! Not landed"
        self._stop_motors("external command")
        return None

    def _stop_motors(self, why: str) -> None:
        self.armed = self.body.motors_on = False
        self.target = None
        self.stop_stream()
        self._climbs_first = False
        self._take_off_to = (None, None, None)
        self.route.stop()
        self._enter(Phase.LANDED)
        self.failsafes.taken_over()
        self.say(SEVERITY_INFO, f"Disarmed by {why}")
        self._change(self._after_disarming)

    # --- modes ----------------------------------------------------------------------------------

    def set_mode(self, mode: Px4Mode) -> str | None:
        """The pilot's wish. Disarmed every mode can be chosen, and arming looks at it."""
        if self.armed and (reason := self._mode_refusal(mode)) is not None:
            return f"{mode.name} not possible: {reason}"
        self.failsafes.taken_over()
        if mode not in UNARMABLE:
            self._after_disarming = mode
        if mode != self.mode:
            self._change(mode)
        return None

    def fail_to(self, mode: Px4Mode) -> None:
        """A failsafe's; without a position it comes down where it is."""
        if not self.position_ok:
            mode = Px4Mode.LAND
        if mode != self.mode:
            self._change(mode)

    def _mode_refusal(self, mode: Px4Mode) -> str | None:
        if mode in BY_HAND and not self.by_hand:
            return "no manual control"
        if mode not in (Px4Mode.LAND, *LEVEL) and not self.position_ok:
            return "no global position"
        if mode == Px4Mode.MISSION and self.route.total == 0:
            return "no valid mission"
        if mode == Px4Mode.OFFBOARD and not self.setpoints.fresh(self.t_s):
            return "no offboard signal"
        return None

    def _change(self, mode: Px4Mode) -> None:
        if mode == self.mode:
            return
        if self.in_mission:
            self.route.stop()
        self.mode = mode
        if not self.failsafes.engaged:
            self._intended = mode
        self._climbs_first = False
        self._leave_mode()
        if self.airborne:
            self._enter(Phase.FLY)
        if self.armed:
            self._begin_mode()

    @abstractmethod
    def _begin_mode(self) -> None:
        """What the mode does of itself, armed."""
