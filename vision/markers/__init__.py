"""Markers on vehicles: found in pictures, and the pose that they give."""
