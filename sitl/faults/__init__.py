"""Faults on demand: kinds, schedules, injection over MAVLink."""
