"""The PX4 flavour of the simulated autopilot: a multicopter of PX4 1.15."""
