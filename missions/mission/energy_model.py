"""The energy model of a mission: what its battery, its wind and its speeds come to."""

from __future__ import annotations

from missions.mission.energy import CLIMB_SPEED_M_S, LANDING_SPEED_M_S, EnergyModel
from missions.mission.schema import Mission


def energy_model(mission: Mission) -> EnergyModel:
    """The model of a mission's battery and wind."""
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
