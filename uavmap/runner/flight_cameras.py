"""The cameras of a flight, as the mission file and the command line describe them."""

from __future__ import annotations

from collections.abc import Sequence

from missions.mission.schema import CameraSection, Mission
from uavmap.aircraft.cameras.mount import Mount
from uavmap.aircraft.cameras.opening import Settings
from uavmap.aircraft.cameras.spec import CameraSpec, parse_camera


def mount_of(camera: CameraSection) -> Mount:
    """How the camera of a mission file is fixed to its aircraft."""
    return Mount(camera.mounting == "fixed", camera.yaw_deg, camera.pitch_deg, camera.roll_deg)


def settings_of(camera: CameraSection) -> Settings:
    """What a mission file says of its cameras."""
    size_px = (camera.width_px, camera.height_px)
    return Settings(size_px, camera.interval_s, camera.latency_s, mount_of(camera))


def cameras_of(
    given: Sequence[str], mission: Mission, member: int | None = None
) -> list[CameraSpec]:
    """The camera of each vehicle: of the command line, else of the mission file.

    Of a member of a fleet that of its own vehicle only. Raises `LinkError` for what is no camera.
    """
    ours = mission.vehicles if member is None else mission.vehicles[member - 1 : member]
    written = given or [v.camera or "mavlink" for v in ours]
    return [parse_camera(text) for text in written]
