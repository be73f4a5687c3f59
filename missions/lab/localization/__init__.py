"""Localization of a robot on a grid that senses only the eight neighbours of its cell.

After Wongngamnit and Angluin, "The Robot, the Grid, and the Algorithm" (1999), with a planner, and
with errors of sensor and odometry. Its page: docs/explanation/localization.md.
"""
