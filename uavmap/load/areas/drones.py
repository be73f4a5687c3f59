"""Common multicopters that speak MAVLink, and cameras for them: the makers' published figures.

docs/reference/drones.md names the sources; this project has measured none of the figures. Hover
power is the energy of the battery divided by the maker's hovering time until it is empty.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from missions.errors import AreaError


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera that points straight down."""

    title: str
    hfov_deg: float
    """Field of view across the width of a picture, degrees."""
    width_px: int
    height_px: int
    interval_s: float
    """Minimum time between two pictures, s."""
    mounting: Literal["fixed", "gimbal"]


@dataclass(frozen=True, slots=True)
class Drone:
    """An airframe with its battery and the camera that it usually has."""

    title: str
    capacity_wh: float
    hover_power_w: float
    max_airspeed_m_s: float
    """Maximum airspeed in level flight, m/s."""
    speed_m_s: float
    """Speed of a mission over ground, m/s."""
    camera: str


def _hfov_deg(sensor_mm: float, focal_mm: float) -> float:
    return round(math.degrees(2.0 * math.atan(sensor_mm / (2.0 * focal_mm))), 1)


CAMERAS: Final[Mapping[str, Camera]] = {
    "sim": Camera("the camera of the bundled simulator", 80.0, 640, 480, 0.2, "fixed"),
    "rpi-v2": Camera("Raspberry Pi Camera Module 2", 62.2, 3280, 2464, 0.5, "fixed"),
    "rpi-v3": Camera("Raspberry Pi Camera Module 3", 66.0, 4608, 2592, 0.5, "fixed"),
    "rpi-v3-wide": Camera("Raspberry Pi Camera Module 3 Wide", 102.0, 4608, 2592, 0.5, "fixed"),
    "rpi-hq-6mm": Camera(
        "Raspberry Pi HQ Camera, 6 mm lens", _hfov_deg(6.287, 6.0), 4056, 3040, 0.5, "fixed"
    ),
    "siyi-a8": Camera("SIYI A8 mini", 81.0, 3840, 2160, 1.0, "gimbal"),
    "yuneec-e90": Camera("Yuneec E90", _hfov_deg(36.0, 23.0), 5472, 3648, 1.0, "gimbal"),
    "sony-a6000-16mm": Camera(
        "Sony a6000, 16 mm lens", _hfov_deg(23.5, 16.0), 6000, 4000, 1.0, "fixed"
    ),
    "sony-lr1-24mm": Camera(
        "Sony ILX-LR1, 24 mm lens", _hfov_deg(35.7, 24.0), 9504, 6336, 1.0, "gimbal"
    ),
}

DRONES: Final[Mapping[str, Drone]] = {
    "sim": Drone("the copter of the bundled simulator", 60.0, 300.0, 12.0, 6.0, "sim"),
    "x500": Drone("Holybro X500 V2, 4S 5000 mAh", 74.0, 247.0, 12.0, 6.0, "rpi-v3"),
    "solo": Drone("3DR Solo with a camera, 5200 mAh", 77.0, 231.0, 15.0, 6.0, "rpi-v3"),
    "iris": Drone("3DR Iris+ with a camera, 3S 5100 mAh", 56.6, 212.0, 11.0, 5.0, "rpi-v2"),
    "h520": Drone("Yuneec H520 with its E90, 5250 mAh", 79.8, 192.0, 13.0, 6.0, "yuneec-e90"),
    "astro": Drone(
        "Freefly Astro Max with an LR1, two SL8-Air", 355.0, 666.0, 15.0, 8.0, "sony-lr1-24mm"
    ),
}
_FOREIGN: Final = ("dji", "mavic", "matrice", "phantom", "autel", "evo", "skydio", "parrot", "m300")


def drone_named(name: str) -> Drone:
    """Return a drone of the table. Raises `AreaError`, which suggests a similar name.

    >>> drone_named("x50")
    Traceback (most recent call last):
    missions.errors.AreaError: --drone x50: not in the table; did you mean 'x500'? ...
    """
    if name in DRONES:
        return DRONES[name]
    if any(word in name.lower() for word in _FOREIGN):
        raise AreaError(
            f"--drone {name}: such aircraft accept no orders over MAVLink, so uavmap cannot fly "
            "them; `uavmap replay` maps their pictures"
        )
    raise AreaError(f"--drone {name}: not in the table;{_guess(name, DRONES)}")


def camera_named(name: str) -> Camera:
    """Return a camera of the table. Raises `AreaError`, which suggests a similar name."""
    if name in CAMERAS:
        return CAMERAS[name]
    raise AreaError(f"--camera {name}: not in the table;{_guess(name, CAMERAS)}")


def _guess(name: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.5)
    guess = f" did you mean {near[0]!r}?" if near else ""
    return f"{guess} `uavmap new --drone list` shows it; or give its figures as options"


def table_lines() -> Iterator[str]:
    """Yield the lines of both tables for the terminal."""
    yield "drones (--drone NAME):"
    yield "  name    battery  hover  airspeed  speed  camera           what"
    for name, drone in DRONES.items():
        yield (
            f"  {name:6}  {drone.capacity_wh:4g} Wh  {drone.hover_power_w:3g} W  "
            f"{drone.max_airspeed_m_s:4g} m/s  {drone.speed_m_s:g} m/s  {drone.camera:15}  "
            f"{drone.title}"
        )
    yield "cameras (--camera NAME):"
    yield "  name             field of view  pixels       interval  mounting  what"
    for name, camera in CAMERAS.items():
        pixels = f"{camera.width_px} x {camera.height_px}"
        yield (
            f"  {name:15}  {camera.hfov_deg:5.1f} degrees  {pixels:11}  {camera.interval_s:6g} s  "
            f"{camera.mounting:8}  {camera.title}"
        )
    yield "these are the makers' figures, not measured (docs/reference/drones.md); "
    "options override them"
