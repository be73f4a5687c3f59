"""The tables of a mission file that only the simulator reads.

`docs/reference/missions.md` has the docstrings of these classes and fields.
"""

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
    """A piece of the true region."""

    polygon: Ring
    """Outline of the piece."""
    holes: tuple[Ring, ...] = ()
    """Holes in the piece."""
    rgb: tuple[Level, Level, Level] | None = None
    """Its colour, by default gray; later pieces cover earlier ones."""


class SimFault(Section):
    """A fault of one vehicle."""

    vehicle: Annotated[Count, Field(ge=1, le=50)] = 1
    """Number of the vehicle, from 1."""
    at_s: NotNegative
    """Beginning, on the time of the mission."""
    for_s: Positive | None = None
    """Duration; by default to the end."""
    kind: Literal[
        "gps", "gps_glitch", "gps_drift", "battery_sag", "battery_cell", "compass", "wind_gust",
        "motor", "camera_stall", "camera_black", "camera_corrupt", "reject", "rc", "link",
        "companion_reboot",
    ]  # fmt: skip
    """Kind of fault."""
    # the methods of `sitl.faults.faults.Faults`, and their values
    metres: Number | None = None
    """For `gps_glitch`: jump of the position."""
    m_s: Number | None = None
    """For `gps_drift` and `wind_gust`: speed."""
    volts: Number | None = None
    """For `battery_sag`: drop of the voltage."""
    deg: Number | None = None
    """For `compass`: error of the heading."""
    toward_deg: Number | None = None
    """For `gps_glitch` and `gps_drift`: true bearing."""
    from_deg: Number | None = None
    """For `wind_gust`: true bearing from which it blows."""
    share: Share | None = None
    """For `motor`: share of its thrust that is left."""
    command: Annotated[Count, Field(ge=0, le=65535)] | None = None
    """For `reject`: number of the MAVLink command."""
    result: Annotated[Count, Field(ge=1, le=255)] | None = None
    """For `reject`: MAV_RESULT of the answer."""
    loss: Share | None = None
    """For `link`: share of frames that are lost."""
    duplicate: Share | None = None
    """For `link`: share of frames that arrive twice."""
    reorder: Share | None = None
    """For `link`: share of frames that arrive out of order."""
    corrupt: Share | None = None
    """For `link`: share of frames with a wrong byte."""
    delay_s: Annotated[Number, Field(ge=0, le=3600)] | None = None
    """For `link`: delay of each frame."""
    jitter_s: Annotated[Number, Field(ge=0, le=3600)] | None = None
    """For `link`: variation of the delay."""
    silent: bool | None = None
    """For `link`: true: no frame arrives."""

    @property
    def values(self) -> dict[str, float]:
        """Return the numbers of this kind of fault that are given."""
        everywhere = {"vehicle", "at_s", "for_s", "kind"}
        return self.model_dump(exclude=everywhere, exclude_none=True)

    @property
    def happens_once(self) -> bool:
        """True if a later start of the simulation does not begin it again."""
        return self.kind in ("battery_cell", "motor", "companion_reboot")

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
    """An aircraft of others that flies straight; receivers on board report it."""

    position: Vertex
    """Its place at `at_s`."""
    height_m: Annotated[Number, Field(ge=-500, le=20_000)] = 100.0
    """Height above the start."""
    toward_deg: Number = 0.0
    """True bearing of its flight."""
    speed_m_s: Annotated[Number, Field(ge=0, le=350)] = 50.0
    """Speed over ground."""
    at_s: NotNegative = 0.0
    """Start of its reports, on the time of the mission."""
    for_s: Positive | None = None
    """Duration; by default to the end."""
    name: Annotated[str, Field(strict=True, max_length=8, pattern=r"^[A-Z0-9]*$")] = ""
    """Its call sign: capitals and digits."""
    kind: Literal["adsb", "utm"] = "adsb"
    """Kind of message: ADSB_VEHICLE or UTM_GLOBAL_POSITION."""


class SimTerrain(Section):
    """Ground that is not level: a slope with hills on it."""

    slope_percent: Annotated[Number, Field(ge=0, le=60)] = 0.0
    """Steepness."""
    rises_toward_deg: Number = 0.0
    """True bearing towards which it rises."""
    hills_m: Annotated[Number, Field(ge=0, le=300)] = 0.0
    """Maximum height from the deepest valley to the highest top."""
    hills_length_m: Annotated[Number, Field(ge=20, le=10000)] = 150.0
    """Minimum distance from one hill to the next."""
    seed: Annotated[Count, Field(ge=0)] = 0
    """Number that chooses the hills."""


class SimQuirks(Section):
    """Surprising habits of real aircraft."""

    camera: Literal["component", "autopilot", "none"] = "component"
    """Component that answers for the camera: its own, the autopilot, or none."""
    camera_clock_s: Annotated[Number, Field(ge=-1e6, le=1e6)] = 0.0
    """Error of the camera's clock."""
    camera_tells_pose: bool = True
    """True: the camera reports the pose of each picture."""
    clock_ppm: Annotated[Number, Field(ge=-200_000, le=200_000)] = 0.0
    """Error of the autopilot's clock rate, in millionths."""
    home_moves_m: Annotated[Number, Field(ge=0, le=20)] = 1.5
    """Distance that home moves when motors are armed."""
    stick: bool = True
    """True: a pilot's radio control is on, its sticks centred."""
    landed_state: bool = True
    """True: it sends EXTENDED_SYS_STATE."""
    height_sigma_m: Annotated[Number, Field(ge=0, le=8)] = 3.0
    """Error of a receiver's height above the sea; it wanders."""
    tilt_sigma_deg: Annotated[Number, Field(ge=0, le=10)] = 0.8
    """Error of its roll and pitch, for some seconds."""
    heading_sigma_deg: Annotated[Number, Field(ge=0, le=10)] = 2.0
    """Error of its heading, for about 20 s."""


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
