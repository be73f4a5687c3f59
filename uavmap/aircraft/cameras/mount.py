"""How a camera is fixed to an aircraft, and how it is turned when the aircraft is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from missions.units import Quaternion

_NADIR: Final = Quaternion.from_euler(0.0, -math.pi / 2.0, 0.0)
"""A camera that looks straight down, its upper edge towards the nose."""


@dataclass(frozen=True, slots=True)
class Mount:
    """A camera under an aircraft that looks straight down, but for small angles.

    `fixed`: bolted to the body, so that it tilts along; else a gimbal holds it straight down and
    only the heading turns it. `yaw_deg` is the bearing of the picture's upper edge relative to the
    nose. `pitch_deg` and `roll_deg` are those of the plate that it is bolted to: by so much it
    looks forward (pitch) and to the left (roll) of straight down.

    >>> level = Quaternion.from_euler(0.0, 0.0, 0.0)
    >>> [round(x, 3) for x in Mount().attitude(level)]
    [0.707, 0.0, -0.707, 0.0]
    """

    fixed: bool = True
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def attitude(self, body: Quaternion) -> Quaternion:
        """Camera axes to NED, of the body's attitude (body axes to NED)."""
        if not self.fixed:
            body = Quaternion.from_euler(0.0, 0.0, heading_rad(body))
        plate = Quaternion.from_euler(
            math.radians(self.roll_deg), math.radians(self.pitch_deg), math.radians(self.yaw_deg)
        )
        return product(body, product(plate, _NADIR))


def heading_rad(q: Quaternion) -> float:
    """Where the nose of a body points, clockwise from north.

    >>> round(math.degrees(heading_rad(Quaternion.from_euler(0.1, 0.2, 1.0))), 3)
    57.296
    """
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First `b`, then `a`."""
    return Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )
