"""The airframe: dynamics, trajectory shaping, battery, sensors. No MAVLink, no autopilot."""
