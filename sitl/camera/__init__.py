"""The simulated camera: rendering, the MAVLink camera component, pictures, geotags."""
