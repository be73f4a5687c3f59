"""What a registration did, for people (a few lines) and programs (registration.json)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from missions.geo.geodesy import LocalPlane
from uavmap.base.printable import printable
from uavmap.photos.registration.refinement import Found, Taken
from vision.camera import euler
from vision.registration.ground_plane import bearing
from vision.registration.picture_features import WIDTH_PX
from vision.registration.views import Agreement, Net, Registration

FILE: Final = "registration.json"
MOST_NAMED: Final = 12
"""Most pictures left as tagged that the screen names; the file names all."""


def report(
    taken: Sequence[Taken], result: Registration, found: Mapping[str, Found]
) -> dict[str, Any]:
    """Return the content of registration.json."""
    return {
        "version": 1,
        "pictures_refined": len(found),
        "pictures_as_tagged": len(taken) - len(found),
        "held_apart": {
            "pixels_of_width": WIDTH_PX,
            "as_tagged": _agreement(result.before),
            "refined": _agreement(result.after),
        },
        "nets": [_net(net, taken) for net in result.nets],
        "pictures": [
            _picture(tag, found.get(tag.picture.name), left)
            for tag, left in zip(taken, result.left, strict=True)
        ],
    }


def lines(taken: Sequence[Taken], result: Registration, found: Mapping[str, Found]) -> list[str]:
    """Return what the screen shows."""
    said = []
    if found and result.after is not None:
        nets = f"{len(result.nets)} net" + ("s" if len(result.nets) > 1 else "")
        pairs = sum(net.pairs for net in result.nets)
        said.append(
            f"registration: {len(found)} of {len(taken)} pictures refined "
            f"({nets}, {pairs} overlaps)"
        )
        before = "" if result.before is None else f"; as tagged to {_metres(result.before)}"
        said.append(f"  they agree on the ground to {_metres(result.after)}{before}")
        after = result.after
        said.append(
            f"  transfer error {after.median_px:.2f} px (median), {after.most_px:.2f} px (90 %) "
            f"in pictures of {WIDTH_PX} px, {after.points} tie points that were kept apart"
        )
        moved = [
            _moved_m(tag, found[tag.picture.name]) for tag in taken if tag.picture.name in found
        ]
        said.append(
            f"  positions moved by {np.median(moved):.1f} m (median), at most {max(moved):.1f} m"
        )
    elif taken:
        said.append(f"registration: none of {len(taken)} pictures could be refined")
    said += [
        f"{name}: stored upside down (it overlaps its neighbours only when turned by 180 degrees); "
        "turned"
        for name, pose in found.items()
        if pose.refined.turned
    ]
    left = [
        (tag.picture.name, why)
        for tag, why in zip(taken, result.left, strict=True)
        if why is not None
    ]
    said += [f"{printable(name)}: left as tagged: {why}" for name, why in left[:MOST_NAMED]]
    if len(left) > MOST_NAMED:
        said.append(f"{len(left) - MOST_NAMED} more are left as tagged: {FILE} names them")
    return said


def _metres(agreement: Agreement) -> str:
    return f"{agreement.median_m:.2f} m (median), {agreement.most_m:.2f} m (90 %)"


def _agreement(agreement: Agreement | None) -> dict[str, Any] | None:
    if agreement is None:
        return None
    return {
        "tie_points": agreement.points,
        "median_m": round(agreement.median_m, 3),
        "p90_m": round(agreement.most_m, 3),
        "median_px": round(agreement.median_px, 3),
        "p90_px": round(agreement.most_px, 3),
    }


def _net(net: Net, taken: Sequence[Taken]) -> dict[str, Any]:
    return {
        "pictures": [taken[k].picture.name for k in net.members],
        "overlaps": net.pairs,
        "focal_length_of_told": {name: round(f, 4) for name, f in net.focal.items()},
        "ground_falls_east_percent": round(100.0 * net.slope[0], 2),
        "ground_falls_north_percent": round(100.0 * net.slope[1], 2),
        "height_tags_off_percent": round(100.0 * net.height_bias, 2),
        "heading_tags_off_deg": round(math.degrees(net.yaw_bias_rad), 2),
        "geotags_off_sigma_m": _rounded(net.position_sigma_m, 2),
    }


def _picture(tag: Taken, found: Found | None, left: str | None) -> dict[str, Any]:
    if found is None:
        return {"name": tag.picture.name, "refined": False, "why": left}
    pose, refined = found.pose, found.refined
    heading = math.degrees(float(bearing(refined.axes[None])[0]))
    east_m, north_m = LocalPlane(tag.position).to_plane(found.tag_position)
    return {
        "name": tag.picture.name,
        "refined": True,
        "net": refined.component,
        "lat_deg": round(pose.position.lat_deg, 8),
        "lon_deg": round(pose.position.lon_deg, 8),
        "height_m": round(pose.height_m, 3),
        "heading_deg": round(heading % 360.0, 2),
        "tilt_deg": round(math.degrees(math.acos(min(1.0, -float(refined.axes[2, 2])))), 2),
        "roll_pitch_yaw_deg": [round(math.degrees(v), 3) for v in euler(pose.attitude)],
        "hfov_deg": round(math.degrees(found.hfov_rad), 3),
        "moved_east_m": round(east_m, 2),
        "moved_north_m": round(north_m, 2),
        "height_changed_m": _rounded(tag.height_m and pose.height_m - tag.height_m.value, 2),
        "upside_down": refined.turned,
        "position_sigma_m": round(refined.position_sigma_m, 2),
        "height_sigma_m": round(refined.height_sigma_m, 2),
        "heading_sigma_deg": round(math.degrees(refined.yaw_sigma_rad), 2),
        "tie_points": refined.matches,
        "transfer_error_px": round(refined.residual_px, 2),
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _moved_m(tag: Taken, found: Found) -> float:
    return math.hypot(*LocalPlane(tag.position).to_plane(found.tag_position))
