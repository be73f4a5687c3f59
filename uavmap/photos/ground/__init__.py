"""Recorded pictures on the ground: projection, surface, mosaic, boundary."""
