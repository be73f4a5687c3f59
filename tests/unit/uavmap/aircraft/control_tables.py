"""Make the transition tables of docs/reference/control.md by running the state machine.

python -m tests.unit.uavmap.aircraft.control_tables  # writes them into the page
"""

from dataclasses import replace
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.aircraft.control import (
    EARLIER_MODE_AFTER_S,
    MAX_LIFT_OFF_S,
    AirState,
    Beat,
    Control,
    Ground,
    Holder,
    Request,
)
from uavmap.mavlink.autopilots import ARDUPILOT, PX4, Autopilot
from uavmap.mavlink.vehicle_view import OFF_GROUND_M

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "control.md"
BEGIN = "<!-- tables of uavmap.aircraft.control -->"
END = "<!-- end of the tables -->"
GUIDED, LOITER, RTL, LAND = ARDUPILOT.follows, 5, ARDUPILOT.rtl, ARDUPILOT.land
NOW_S = EARLIER_MODE_AFTER_S + 0.1

FLYING = Control(
    air=AirState.AIRBORNE, mode=GUIDED, armed=True, received_s=MAX_LIFT_OFF_S, took_off_s=0.0
)
ASKED = replace(FLYING, request=Request(RTL, 0.0, before=GUIDED))
"""Control of a vehicle that flies in GUIDED after a request for RTL."""
SEEN = replace(FLYING, mode=RTL, request=Request(RTL, 0.0, confirmed=True))
STREAM = replace(
    FLYING,
    mode=PX4.follows,
    request=Request(PX4.stream_mode, 0.0, before=PX4.follows, acknowledged_s=0.0),
)
CLIMB = replace(
    FLYING, mode=PX4.takes_off_in, request=Request(PX4.takes_off_in, 0.0, confirmed=True)
)
STANDING = Control(air=AirState.ON_GROUND, mode=LAND)
TAKEN = replace(STANDING, taken_on_ground=True)

Case = tuple[str, Control, Autopilot, int, bool, bool]
CASES = (
    ("the mode asked for", ASKED, ARDUPILOT, RTL, True, False),
    ("the mode before the request", ASKED, ARDUPILOT, GUIDED, True, False),
    (
        f"... {EARLIER_MODE_AFTER_S:g} s after a PX4 acknowledged OFFBOARD",
        STREAM, PX4, PX4.follows, True, False,
    ),
    ("any other mode, as LAND while RTL is asked for", ASKED, ARDUPILOT, LAND, True, False),
    ("HOLD of a PX4 at the end of its TAKEOFF", CLIMB, PX4, PX4.follows, True, False),
    ("any mode by a failsafe (PX4: CRITICAL)", SEEN, PX4, PX4.rtl, True, True),
    ("GUIDED (PX4: HOLD) after the mode asked for", SEEN, ARDUPILOT, GUIDED, True, False),
    ("motors off: another mode", STANDING, ARDUPILOT, LOITER, False, False),
    ("motors off: GUIDED (PX4: HOLD)", STANDING, ARDUPILOT, GUIDED, False, False),
    ("the same, taken with its motors off", TAKEN, ARDUPILOT, GUIDED, False, False),
)  # fmt: skip


def holder_after(case, holder):
    _, start, kind, mode, armed, failsafe = case
    return replace(start, holder=holder).with_beat(kind, Beat(mode, armed, failsafe, NOW_S)).holder


def stood(armed, landed_state, height_m):
    """Report the vehicle on the ground, long after NAV_TAKEOFF."""
    ground = Ground(armed, landed_state, height_m)
    return lambda start: start.with_ground(ground, ARDUPILOT, MAX_LIFT_OFF_S + 1.0)


ON, UP = mav.MAV_LANDED_STATE_ON_GROUND, mav.MAV_LANDED_STATE_IN_AIR
UNDEFINED = mav.MAV_LANDED_STATE_UNDEFINED
STEPS = (
    ("we send NAV_TAKEOFF", lambda start: start.with_take_off(0.0)),
    ("armed, off the ground", stood(True, UP, 5.0)),
    ("the same in LAND", lambda start: stood(True, UP, 5.0)(replace(start, mode=LAND))),
    (
        "armed, on the ground",
        lambda start: start.with_ground(Ground(True, ON, 0.0), ARDUPILOT, MAX_LIFT_OFF_S - 1.0),
    ),
    (f"the same {MAX_LIFT_OFF_S:g} s after NAV_TAKEOFF", stood(True, ON, 0.0)),
    ("motors off, on the ground", stood(False, ON, 0.0)),
    ("motors off, off the ground", stood(False, UP, 5.0)),
    (f"no landed state, armed, above {OFF_GROUND_M:g} m", stood(True, UNDEFINED, 5.0)),
    ("no landed state, armed, lower", stood(True, UNDEFINED, 0.0)),
    ("no landed state, motors off", stood(False, UNDEFINED, 0.0)),
    ("the guardian sees that it crashed", lambda start: start.with_crash()),
)


def air_after(step, air):
    """Return the state of flight after a step, for a vehicle that took off at 0 s."""
    return step(replace(FLYING, air=air)).air


def tables():
    held = [(case[0], *(holder_after(case, h).value for h in Holder)) for case in CASES]
    flown = [(name, *(air_after(step, a).value for a in AirState)) for name, step in STEPS]
    return "\n\n".join(
        (
            table("the vehicle reports", [holder.value for holder in Holder], held),
            table("the vehicle reports, or", [air.value for air in AirState], flown),
        )
    )


def table(first, columns, rows):
    lines = [(first, *(f"{column}" for column in columns)), ("---",) * (len(columns) + 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


if __name__ == "__main__":
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{tables()}\n{END}{after}", encoding="utf-8")
