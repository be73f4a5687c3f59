"""The energy of legs and landings.

An airborne vehicle always keeps the energy of its return against the worst known wind, of the
landing, and its reserve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from missions.mission.schema import Mission

LANDING_SPEED_M_S = 0.5
"""ArduCopter's final descent rate, m/s; used for the whole descent if no other is given."""
FINAL_M = 10.0
"""Height below which a landing is slow: ArduCopter's LAND_ALT_LOW and PX4's MPC_LAND_ALT1, m."""
CLIMB_SPEED_M_S = 1.5
LANDING_OVERHEAD_S = 12.0
"""Time for braking, turning, and touch-down detection, s."""
CLIMB_OVERHEAD_S = 5.0
"""Time for arming, spinning up, and levelling out at the top, s."""
AIRSPEED_LIMIT_M_S = 12.0
"""Airspeed that a mapping multicopter can hold, m/s; ArduCopter's tilt limit mostly allows more."""
MIN_HEADWAY_M_S = 0.5
"""Minimum ground speed of a return against the wind, m/s."""
NOMINAL_MARGIN = 1.15
"""Power of forward flight as a multiple of hovering."""
MEASURED_MARGIN = 1.1
FRESH = 0.9
"""Share of its capacity from which on a battery counts as fresh."""


@dataclass(frozen=True, slots=True)
class EnergyModel:
    """Energy for legs and landings, in watt hours.

    >>> model = EnergyModel(hover_power_w=300, capacity_wh=60, reserve=0.1, speed_m_s=5, wind_m_s=3)
    >>> model.reserve_wh
    6.0
    """

    hover_power_w: float
    capacity_wh: float
    reserve: float
    speed_m_s: float
    wind_m_s: float
    accel_m_s2: float = 2.0
    max_airspeed_m_s: float = AIRSPEED_LIMIT_M_S
    climb_m_s: float = CLIMB_SPEED_M_S
    descent_m_s: float = LANDING_SPEED_M_S
    """Descent rate above `FINAL_M`, m/s; below it is `LANDING_SPEED_M_S`."""

    def in_wind(self, measured_m_s: float) -> EnergyModel:
        """Return the model in the given or a measured wind, whichever is stronger."""
        if measured_m_s <= self.wind_m_s:
            return self
        return replace(self, wind_m_s=measured_m_s)

    @property
    def reserve_wh(self) -> float:
        """Energy that must be left at touch-down, Wh."""
        return self.reserve * self.capacity_wh

    def power_w(self, drawn_w: float) -> float:
        """Return the power for estimates, given the recent consumption (0: not known), W."""
        return max(NOMINAL_MARGIN * self.hover_power_w, MEASURED_MARGIN * drawn_w)

    def leg_s(self, distance_m: float) -> float:
        """Return the time for a leg from rest to rest, s.

        A multicopter keeps its ground speed against a head wind by tilting, at a higher power, up
        to its maximum airspeed.
        """
        against_wind = max(self.max_airspeed_m_s - self.wind_m_s, MIN_HEADWAY_M_S)
        speed = min(self.speed_m_s, against_wind)
        # acceleration and braking are computed for still air, so that wind never shortens a leg
        return distance_m / speed + self.speed_m_s / self.accel_m_s2

    def leg_wh(self, distance_m: float, drawn_w: float = 0.0) -> float:
        """Return the energy for a leg, Wh."""
        return self.power_w(drawn_w) * self.leg_s(distance_m) / 3600.0

    def hover_wh(self, duration_s: float, drawn_w: float = 0.0) -> float:
        """Return the energy for hovering, Wh."""
        return self.power_w(drawn_w) * duration_s / 3600.0

    def climb_wh(self, height_m: float) -> float:
        """Return the energy to take off and climb, Wh."""
        return self.hover_wh(height_m / self.climb_m_s + CLIMB_OVERHEAD_S)

    def relief_wh(self, ups_and_downs_m: float, drawn_w: float = 0.0) -> float:
        """Return the energy for ups and downs besides the length of a path, Wh.

        They count as climbed separately: on steep ground a vehicle flies slower.
        """
        return self.hover_wh(ups_and_downs_m / self.climb_m_s, drawn_w)

    def sortie_wh(self, out_m: float, home_m: float, height_m: float, hover_s: float) -> float:
        """Return the energy of a whole flight: climb, fly out, hover, return, land, reserve left,
        Wh."""
        return (
            self.climb_wh(height_m)
            + self.leg_wh(out_m)
            + self.hover_wh(hover_s)
            + self.home_wh(home_m, height_m)
        )

    def home_wh(self, distance_m: float, height_m: float, drawn_w: float = 0.0) -> float:
        """Return the energy to fly home, land, and have the reserve left, Wh."""
        landing_s = self.descent_s(height_m) + LANDING_OVERHEAD_S
        return (
            self.leg_wh(distance_m, drawn_w) + self.hover_wh(landing_s, drawn_w) + self.reserve_wh
        )

    def descent_s(self, height_m: float) -> float:
        """Return the time of a descent from a height to the ground, without any pause, s.

        >>> model = EnergyModel(300, 60, 0.1, speed_m_s=5, wind_m_s=3, descent_m_s=3.0)
        >>> model.descent_s(100.0), model.descent_s(4.0)
        (50.0, 8.0)
        """
        final_m = min(height_m, FINAL_M)
        return final_m / LANDING_SPEED_M_S + (height_m - final_m) / self.descent_m_s


def energy_model(mission: Mission) -> EnergyModel:
    """Return the model of a mission's battery and wind."""
    return EnergyModel(
        mission.battery.hover_power_w,
        mission.battery.capacity_wh,
        mission.battery.reserve,
        mission.flight.speed_m_s,
        mission.wind.speed_m_s,
        accel_m_s2=mission.flight.accel_m_s2,
        max_airspeed_m_s=mission.flight.max_airspeed_m_s,
        climb_m_s=mission.flight.climb_m_s or CLIMB_SPEED_M_S,
        descent_m_s=mission.flight.descent_m_s or LANDING_SPEED_M_S,
    )
