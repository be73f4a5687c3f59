"""An example of each kind of fault in a mission file."""

from __future__ import annotations

FAULTS = {
    "gps": "",
    "gps_glitch": "metres = 5.0",
    "gps_drift": "m_s = 2.0",
    "battery_sag": "volts = 4.0",
    "battery_cell": "",
    "compass": "deg = 20.0",
    "wind_gust": "m_s = 5.0",
    "motor": "share = 0.5",
    "camera_stall": "",
    "camera_black": "",
    "camera_corrupt": "",
    "reject": "command = 192",
    "rc": "",
    "link": "loss = 0.2",
    "companion_reboot": "",
}
"""A value of each kind; empty for a kind without values."""
