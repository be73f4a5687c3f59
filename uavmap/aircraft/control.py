"""Control of one vehicle and its state of flight: one state machine, derived from messages alone.

    reports of the vehicle, our own requests -> Control -> may we send, is it in the air

`Control` is a value: each report and each request gives the next one. It has no clock and sends
nothing. `uavmap.aircraft.guardian.monitor` keeps the latest and reports its changes;
`uavmap.aircraft.controlled_commands` asks it before anything is sent.

The rule of control: a mode that is neither the requested one nor the one before the request is the
pilot's or a failsafe's. Once the requested mode was reported, only that one is under our control.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.autopilots import Autopilot
from uavmap.mavlink.vehicle_view import OFF_GROUND, OFF_GROUND_M

MAX_MODE_AGE_S: Final = 0.3
"""Maximum age of the reported mode when another mode is commanded, s."""
HEARTBEAT_WAIT_S: Final = 1.2
"""Maximum wait for the next heartbeat before a mode is commanded, s."""
LATE_REQUEST_S: Final = 3.0
"""Time for which an earlier request, never confirmed, may still be carried out, s."""
EARLIER_MODE_AFTER_S: Final = 0.5
"""Time after an acknowledged request from which the mode before it is the pilot's, s."""
MOTORS_OFF_AFTER_S: Final = 1.0
"""Time after NAV_TAKEOFF from which a heartbeat without motors ends the take-off, s."""
MAX_LIFT_OFF_S: Final = 12.0
"""Maximum time from an accepted take-off to leaving the ground, s."""

FlownMode = Literal["follow", "rtl", "land", "other"]
"""The guardian's name for a mode: by our targets, by the autopilot, or by another."""


class Holder(Enum):
    """The holder of control, whose commands the vehicle follows."""

    OURS = "ours"
    GUARDIAN = "guardian's"
    PILOT = "pilot's"
    FAILSAFE = "failsafe's"


class AirState(Enum):
    """The state of flight."""

    UNKNOWN = "unknown"
    ON_GROUND = "on the ground"
    TAKING_OFF = "taking off"
    AIRBORNE = "airborne"
    LANDING = "landing"
    DOWN = "down"

    @property
    def is_flying(self) -> bool:
        """True if it was reported off the ground, and not on the ground since."""
        return self in (AirState.AIRBORNE, AirState.LANDING)

    @property
    def may_be_up(self) -> bool:
        """True if it counts as in the air: from the first NAV_TAKEOFF that is sent."""
        return self.is_flying or self is AirState.TAKING_OFF


@dataclass(frozen=True, slots=True)
class Request:
    """The present request for a mode."""

    mode: int
    since_s: float
    before: int | None = None
    """Mode at the request; under our control until the requested mode is reported."""
    late: tuple[int, ...] = ()
    """Modes of earlier requests that may take effect until `LATE_REQUEST_S` after this one."""
    confirmed: bool = False
    acknowledged_s: float | None = None
    """Time of the autopilot's first acknowledgement, s; None again if it then refused it."""

    def allows(self, mode: int, now_s: float) -> bool:
        """Return whether another mode than the requested one follows from our requests."""
        if mode in self.late and now_s - self.since_s <= LATE_REQUEST_S:
            return True
        put_back = (
            self.acknowledged_s is not None and now_s - self.acknowledged_s > EARLIER_MODE_AFTER_S
        )
        return mode == self.before and not self.confirmed and not put_back


class Beat(NamedTuple):
    """The content of HEARTBEAT or CURRENT_MODE, with the time of its arrival."""

    mode: int
    armed: bool
    failsafe: bool
    """True if a failsafe flies."""
    t_s: float
    landed_state: int | None = None
    """Last reported MAV_LANDED_STATE, for a CURRENT_MODE.

    It holds the mode alone: armed and failsafe are those of the heartbeat before it.
    """


@dataclass(frozen=True, slots=True)
class Ground:
    """The vehicle's reports on being on the ground."""

    armed: bool
    landed_state: int
    """MAV_LANDED_STATE; UNDEFINED if none was reported for a while."""
    height_m: float | None
    """Height above home, m; None if it was not reported."""

    def off(self, air: AirState) -> bool:
        """Return whether it is off the ground: by the landed state, else by armed and height."""
        if self._is_unreported:
            up = self.height_m is not None and self.height_m > OFF_GROUND_M
            return self.armed and (up or air.is_flying)
        return self.armed and self.landed_state in OFF_GROUND

    @property
    def stands(self) -> bool:
        """True if it is on the ground with its motors off."""
        return not self.armed and (self._is_unreported or self._reported_on_ground)

    @property
    def on(self) -> bool:
        """True if it is reported on the ground, with its motors on or off."""
        return self.stands or self._reported_on_ground

    @property
    def _reported_on_ground(self) -> bool:
        return bool(self.landed_state == mav.MAV_LANDED_STATE_ON_GROUND)

    @property
    def _is_unreported(self) -> bool:
        return bool(self.landed_state == mav.MAV_LANDED_STATE_UNDEFINED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """The holder of a vehicle's control, its mode, and whether it flies."""

    holder: Holder = Holder.OURS
    cause: str = ""
    """Cause of a failsafe, in the autopilot's words."""
    request: Request | None = None
    """None: no mode was requested, and it is in the mode in which it was found."""
    air: AirState = AirState.UNKNOWN
    off_ground: bool = False
    """True if the latest report has it off the ground."""
    mode: int | None = None
    armed: bool = False
    failsafe: bool = False
    """True if the heartbeat reports that a failsafe flies."""
    received_s: float = float("-inf")
    """Time of the last report of the mode, s."""
    mode_changes: int = 0
    taken_on_ground: bool = False
    """True if the pilot took control with its motors off: control may also return there."""
    took_off_s: float = float("-inf")
    """Time of the last NAV_TAKEOFF, s."""

    @property
    def is_under_control(self) -> bool:
        """True if the mission or the guardian may send."""
        return self.holder in (Holder.OURS, Holder.GUARDIAN)

    @property
    def in_air(self) -> bool:
        """True if it counts as in the air: armed, and not known to be on the ground."""
        return self.armed and self.air is not AirState.ON_GROUND

    def is_mode_known(self, now_s: float) -> bool:
        """Return whether the mode is known well enough to command another."""
        return now_s - self.received_s <= MAX_MODE_AGE_S

    def flown(self, kind: Autopilot) -> FlownMode:
        """Return the mode by the guardian's name."""
        if not self.is_under_control or self.failsafe:
            return "other"
        if self.mode == kind.rtl:
            return "rtl"
        if self.mode == kind.land:
            return "land"
        by_targets = self.mode in (kind.follows, kind.takes_off_in, kind.stream_mode)
        return "follow" if by_targets else "other"

    # --- what the vehicle reports ----------------------------------------------------------------
    def with_content(self, beat: Beat) -> Control:
        """Return the control with the content of a heartbeat, before it is judged."""
        turned = self.mode is not None and beat.mode != self.mode
        return replace(
            self, mode=beat.mode, armed=beat.armed, failsafe=beat.failsafe, received_s=beat.t_s,
            mode_changes=self.mode_changes + turned,
        )  # fmt: skip

    def with_beat(self, kind: Autopilot, beat: Beat) -> Control:
        """Return the control after a report of the mode."""
        if self._waits_for_heartbeat(kind, beat):
            return replace(self, received_s=float("-inf"))
        mode, armed, failsafe, now_s, _ = beat
        before, was_armed = self.mode, self.armed
        turned = before is not None and mode != before
        now = self.with_content(beat)
        if not self.is_under_control:
            given = turned and mode == kind.follows and before not in kind.by_itself
            # control taken in the air returns in the air: a landed PX4 holds by itself
            if given and not failsafe and (armed or self.taken_on_ground):
                return now._holding(mode, now_s)
            return replace(now, holder=Holder.FAILSAFE) if armed and failsafe else now
        if armed and failsafe:
            return replace(now, holder=Holder.FAILSAFE, taken_on_ground=False)
        request = self.request
        if request is not None and mode == request.mode:
            return replace(now, request=replace(request, before=None, confirmed=True))
        if request is not None and request.allows(mode, now_s):
            return now
        ends = request is not None and request.mode in kind.by_itself and request.confirmed
        if ends and mode == kind.follows:
            return now._holding(mode, now_s)
        if armed:
            found = request is None and mode in (kind.follows, kind.takes_off_in)
            return now._holding(mode, now_s) if found else replace(now, holder=Holder.PILOT)
        # disarming changes the mode of a PX4, and a turn to the requested mode is no objection
        quiet = was_armed or not turned or failsafe or self.air.may_be_up or mode == kind.follows
        if not quiet:
            return replace(now, holder=Holder.PILOT, taken_on_ground=True)
        pending = request is not None and not request.confirmed
        return now if pending else replace(now, request=None)

    def _waits_for_heartbeat(self, kind: Autopilot, beat: Beat) -> bool:
        """Return whether a mode can be judged only with a heartbeat.

        A PX4 goes into Hold when it disarms after a landing, and in a failsafe that waits.
        """
        if beat.landed_state is None or beat.mode != kind.follows or beat.mode == self.mode:
            return False
        lands = self.mode in (kind.rtl, kind.land)
        return not self.is_under_control or (lands and beat.landed_state not in OFF_GROUND)

    def with_connection(self, kind: Autopilot, *, resumed: bool) -> Control:
        """Return the control by the mode reported when a link was opened, or is back.

        `resumed`: it was returning or landing by our command when an earlier process ended.
        """
        if not self.in_air:
            # on the ground the pilot has not taken it yet, in any mode
            return replace(self, holder=Holder.OURS, request=None, taken_on_ground=False)
        modes = {kind.follows, kind.takes_off_in}
        if resumed:
            modes |= {kind.rtl, kind.land}
        request = self.request
        if request is not None and self.is_under_control:
            modes |= {request.mode, *request.late}
        if self.failsafe or self.mode not in modes:
            taken = Holder.FAILSAFE if self.failsafe else Holder.PILOT
            return replace(self, holder=taken, taken_on_ground=False)
        if self.mode is None or (request is not None and request.mode == self.mode):
            return self
        return self._holding(self.mode, self.received_s)

    def with_acknowledgement(self, now_s: float) -> Control:
        """Return the control after the autopilot acknowledged the request."""
        if self.request is None or self.request.acknowledged_s is not None:
            return self
        return replace(self, request=replace(self.request, acknowledged_s=now_s))

    def with_denial(self) -> Control:
        """Return the control after the autopilot did not carry out an acknowledged request."""
        if self.request is None:
            return self
        return replace(self, request=replace(self.request, acknowledged_s=None))

    def with_cause(self, cause: str | None) -> Control:
        """Return the control with the cause of its loss; None: it was no failsafe."""
        if self.is_under_control or cause is None:
            return self
        return replace(self, holder=Holder.FAILSAFE, cause=cause)

    def with_ground(self, ground: Ground, kind: Autopilot, now_s: float) -> Control:
        """Return the control after a report of the ground."""
        air = _air_after(self, ground, kind, now_s)
        off_ground = ground.off(self.air)
        if air is self.air and off_ground == self.off_ground:
            return self
        request = self.request
        if air is AirState.ON_GROUND and self.air.is_flying and request and request.confirmed:
            request = None  # it stays in the mode in which it landed until it is changed
        return replace(self, air=air, off_ground=off_ground, request=request)

    # --- what we do ------------------------------------------------------------------------------
    def with_request(self, mode: int, now_s: float) -> Control:
        """Return the control after a request for a mode, just before it is sent."""
        old = self.request
        if old is not None and old.mode == mode:
            return replace(self, request=replace(old, acknowledged_s=None))
        late: tuple[int, ...] = ()
        if old is not None and not old.confirmed and now_s - old.since_s <= LATE_REQUEST_S:
            late = (*old.late, old.mode)
        there = mode == self.mode and not late
        request = Request(mode, now_s, None if there else self.mode, late, there)
        return replace(self, request=request)

    def with_refusal(self) -> Control:
        """Return the control after the autopilot refused a request: the mode stays."""
        if (
            not self.is_under_control
            or self.request is None
            or self.request.confirmed
            or self.mode is None
        ):
            return self
        return self._holding(self.mode, self.request.since_s)

    def with_take_off(self, now_s: float) -> Control:
        """Return the control after NAV_TAKEOFF was sent."""
        air = self.air if self.air.is_flying else AirState.TAKING_OFF
        return replace(self, air=air, took_off_s=now_s)

    def with_guardian(self, *, guardian: bool) -> Control:
        """Return the control after the guardian took it from the mission, or returned it."""
        if not self.is_under_control:
            return self
        return replace(self, holder=Holder.GUARDIAN if guardian else Holder.OURS)

    def with_crash(self) -> Control:
        """Return the control after a crash was detected."""
        return replace(self, air=AirState.DOWN)

    def _holding(self, mode: int, now_s: float) -> Control:
        holder = self.holder if self.is_under_control else Holder.OURS
        request = Request(mode, now_s, confirmed=True)
        return replace(self, holder=holder, cause="", request=request, taken_on_ground=False)


def _air_after(control: Control, ground: Ground, kind: Autopilot, now_s: float) -> AirState:
    air = control.air
    if air is AirState.DOWN:
        return air  # a vehicle that is down does not fly, whatever it reports
    if ground.off(air):
        lands = control.mode == kind.land
        return AirState.LANDING if lands else AirState.AIRBORNE
    if air is AirState.TAKING_OFF:
        # its arming may be reported later than it was acknowledged
        stands = ground.stands and control.received_s - control.took_off_s > MOTORS_OFF_AFTER_S
        down = ground.on and now_s - control.took_off_s > MAX_LIFT_OFF_S
        return AirState.ON_GROUND if stands or down else air
    if ground.stands:
        return AirState.ON_GROUND
    return AirState.ON_GROUND if ground.on and air is AirState.UNKNOWN else air
