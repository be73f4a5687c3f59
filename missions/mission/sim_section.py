"""The tables of a mission file that only the simulator reads (docs/reference/missions.md)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from missions.mission.sections import (
    Count,
    NotNegative,
    Number,
    Positive,
    Ring,
    Section,
    Share,
    TagDictionary,
    Vertex,
)

Level = Annotated[Count, Field(ge=0, le=255)]


class SimRegion(Section):
    """One piece of the true ROI, for the simulator only."""

    polygon: Ring
    holes: tuple[Ring, ...] = ()
    rgb: tuple[Level, Level, Level] | None = None
    """Red, green, blue in full light; later pieces lie on earlier ones.

    Without it the piece is gray, of `sim.roi_intensity`.
    """


class SimFault(Section):
    """A fault in the simulation; the kinds are those of `sitl.faults.faults`."""

    vehicle: Annotated[Count, Field(ge=1, le=50)] = 1
    """Number of the vehicle; no effect if it does not fly."""
    at_s: NotNegative
    for_s: Positive | None = None
    kind: Literal[
        "gps", "gps_glitch", "gps_drift", "battery_sag", "battery_cell", "compass", "wind_gust",
        "motor", "camera_stall", "camera_black", "camera_corrupt", "reject", "rc", "link",
        "companion_reboot",
    ]  # fmt: skip
    metres: Number | None = None
    m_s: Number | None = None
    volts: Number | None = None
    deg: Number | None = None
    toward_deg: Number | None = None
    from_deg: Number | None = None
    share: Share | None = None
    command: Annotated[Count, Field(ge=0, le=65535)] | None = None
    result: Annotated[Count, Field(ge=1, le=255)] | None = None
    loss: Share | None = None
    duplicate: Share | None = None
    reorder: Share | None = None
    corrupt: Share | None = None
    delay_s: Annotated[Number, Field(ge=0, le=3600)] | None = None
    jitter_s: Annotated[Number, Field(ge=0, le=3600)] | None = None
    silent: bool | None = None

    @property
    def values(self) -> dict[str, float]:
        """Return the numbers of this kind of fault that are given."""
        everywhere = {"vehicle", "at_s", "for_s", "kind"}
        return self.model_dump(exclude=everywhere, exclude_none=True)

    @model_validator(mode="after")
    def _fitting_values(self) -> SimFault:
        needed, possible = _FAULT_VALUES.get(self.kind, ((), ()))
        given = set(self.values)
        if missing := [key for key in needed if key not in given]:
            raise ValueError(f"kind = {self.kind!r} needs {', '.join(missing)}")
        if foreign := sorted(given - {*needed, *possible}):
            raise ValueError(f"kind = {self.kind!r} has no {', '.join(foreign)}")
        if self.kind == "link" and not given:
            raise ValueError(f"kind = 'link' needs one of {', '.join(possible)}")
        if self.kind == "battery_cell" and self.for_s is not None:
            raise ValueError("kind = 'battery_cell' has no for_s: a dead cell stays dead")
        return self


# for each kind of fault: the keys that it needs, and those that it may have
_FAULT_VALUES: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "gps_glitch": (("metres",), ("toward_deg",)),
    "gps_drift": (("m_s",), ("toward_deg",)),
    "battery_sag": (("volts",), ()),
    "compass": (("deg",), ()),
    "wind_gust": (("m_s",), ("from_deg",)),
    "motor": ((), ("share",)),
    "reject": (("command",), ("result",)),
    "link": ((), ("loss", "duplicate", "reorder", "corrupt", "delay_s", "jitter_s", "silent")),
}


class SimIntruder(Section):
    """An aircraft of others that flies straight and is received by all vehicles."""

    position: Vertex
    height_m: Annotated[Number, Field(ge=-500, le=20_000)] = 100.0
    """Above the start."""
    toward_deg: Number = 0.0
    speed_m_s: Annotated[Number, Field(ge=0, le=350)] = 50.0
    at_s: NotNegative = 0.0
    for_s: Positive | None = None
    name: Annotated[str, Field(strict=True, max_length=8, pattern=r"^[A-Z0-9]*$")] = ""
    kind: Literal["adsb", "utm"] = "adsb"


class SimTerrain(Section):
    """Ground that is not level: a slope, and smooth hills on it."""

    slope_percent: Annotated[Number, Field(ge=0, le=60)] = 0.0
    rises_toward_deg: Number = 0.0
    hills_m: Annotated[Number, Field(ge=0, le=300)] = 0.0
    hills_length_m: Annotated[Number, Field(ge=20, le=10000)] = 150.0
    seed: Annotated[Count, Field(ge=0)] = 0


class SimQuirks(Section):
    """Properties of real aircraft that complicate a client; see `sitl.quirks`."""

    camera: Literal["component", "autopilot", "none"] = "component"
    camera_clock_s: Annotated[Number, Field(ge=-1e6, le=1e6)] = 0.0
    camera_tells_pose: bool = True
    clock_ppm: Annotated[Number, Field(ge=-200_000, le=200_000)] = 0.0
    home_moves_m: Annotated[Number, Field(ge=0, le=20)] = 1.5
    stick: bool = True
    landed_state: bool = True
    height_sigma_m: Annotated[Number, Field(ge=0, le=8)] = 3.0
    tilt_sigma_deg: Annotated[Number, Field(ge=0, le=10)] = 0.8
    heading_sigma_deg: Annotated[Number, Field(ge=0, le=10)] = 2.0


class Sim(Section):
    """The world that `--sim` and `uavmap sitl` fly in; the mission itself never reads it."""

    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    world: tuple[str, ...] = ()
    roi: tuple[SimRegion, ...] = ()
    roi_intensity: Annotated[Count, Field(ge=0, le=255)] = 85
    ground_intensity: Annotated[Count, Field(ge=0, le=255)] = 190
    texture: NotNegative = 14.0
    sensor_noise: NotNegative = 4.0
    illumination: Annotated[Number, Field(ge=0, lt=1)] = 0.08
    gust_m_s: NotNegative = 0.5
    gps_sigma_m: NotNegative = 0.3
    gps_tau_s: Positive = 60.0
    optical_flow: bool = False
    odometry_drift: Annotated[Number, Field(ge=0, le=0.5)] = 0.02
    swap_s: NotNegative = 60.0
    tag_m: Annotated[Number, Field(ge=0, le=5)] | None = None
    """Edge of the marker; by default `navigation.tag_m` in a leapfrog, else none."""
    tag_dictionary: TagDictionary | None = None
    """Dictionary of the marker; by default `navigation.tag_dictionary`."""
    terrain: SimTerrain | None = None
    """Ground; by default that of `terrain.dem`, or level."""
    quirks: SimQuirks = SimQuirks()
    parameters: Mapping[str, Number] = Field(default_factory=dict)
    faults: tuple[SimFault, ...] = ()
    traffic: tuple[SimIntruder, ...] = ()
