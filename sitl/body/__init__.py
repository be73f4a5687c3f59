"""The airframe: dynamics, battery, sensors. No MAVLink, no autopilot."""
