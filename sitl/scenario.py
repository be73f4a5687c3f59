"""The parts of a simulation, and their construction: a home, vehicles, wind, a world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from missions.errors import UavmapError
from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.vehicle_spec import FLAVOURS, Equipment
from sitl.world.files import load_ground
from sitl.world.world import Conditions, Patch, World, WorldSpec

_BETWEEN_M = 3.0  # from one vehicle's place of start to the next
_A_ROW = 8
_MOST = 100
_MAX_WIND_M_S = 40.0


@dataclass(frozen=True, slots=True)
class Home:
    """Place and heading of the first vehicle."""

    lat_deg: float = 47.397742
    lon_deg: float = 8.545594
    amsl_m: float = 488.0
    yaw_deg: float = 0.0

    @classmethod
    def parse(cls, text: str | Sequence[float]) -> Home:
        """Read `LAT,LON`, `LAT,LON,AMSL` or `LAT,LON,AMSL,YAW`; raises `UavmapError`."""
        parts = text.split(",") if isinstance(text, str) else list(text)
        try:
            numbers = [float(part) for part in parts]
        except (TypeError, ValueError):
            numbers = []
        if not (2 <= len(numbers) <= 4 and all(map(math.isfinite, numbers))):
            raise UavmapError(f"home {text!r} is not LAT,LON,AMSL,YAW in degrees and metres")
        home = cls(numbers[0], numbers[1], *(numbers[2:] or (0.0,)))
        # beyond these latitudes the local plane bends too much
        if not (abs(home.lat_deg) <= 85.0 and abs(home.lon_deg) <= 180.0):
            raise UavmapError(f"home {text!r}: latitude is -85 to 85, longitude -180 to 180")
        if not abs(home.amsl_m) <= 9000.0:
            raise UavmapError(f"home {text!r}: the third number is the height above sea level, m")
        return home

    @property
    def position(self) -> LatLon:
        """Latitude and longitude."""
        return LatLon(self.lat_deg, self.lon_deg)


@dataclass(frozen=True, kw_only=True)
class Setup(Conditions, Equipment):
    """A simulation; equal setups make equal simulations.

    Attributes:
        home: Place of the first vehicle; the world's origin.
        places: One for each vehicle; by default three metres apart.
        pad_heights_m: Heights of the places above ground without relief.
        speedup, tcp: On sockets only.
        world: Files of `sitl.world.files`; `world_epsg`: the coordinate system of a world file.
        patches: Regions besides.
        parameters: Parameters of the autopilots, as their owner has set them.

    Raises:
        UavmapError: It cannot be simulated.
    """

    vehicles: int = 1
    home: Home | str | Sequence[float] = field(default_factory=Home)
    places: Sequence[LatLon] = ()
    pad_heights_m: Sequence[float] = ()
    speedup: float = 10.0
    tcp: bool = False
    world: Sequence[Path | str] = ()
    world_epsg: int | None = None
    patches: Sequence[Patch] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.autopilot not in FLAVOURS:
            raise UavmapError(f"autopilot {self.autopilot!r}: there is {', '.join(FLAVOURS)}")
        if not 1 <= self.vehicles <= _MOST:
            raise UavmapError(f"vehicles: {self.vehicles} is not 1 to {_MOST}")
        if self.places and len(self.places) != self.vehicles:
            raise UavmapError(f"vehicles: {self.vehicles} have {len(self.places)} places")
        if not 0.0 < self.speedup <= 1000.0:
            raise UavmapError(f"speedup: {self.speedup} is not above 0 and at most 1000")
        if not (isinstance(self.seed, int) and self.seed >= 0):
            raise UavmapError(f"seed: {self.seed} is not 0 or more")
        if not (0.0 <= self.wind_speed_m_s <= _MAX_WIND_M_S and math.isfinite(self.wind_from_deg)):
            raise UavmapError(
                f"wind: {self.wind_speed_m_s} m/s from {self.wind_from_deg} is not 0 to "
                f"{_MAX_WIND_M_S:g} m/s from a bearing"
            )
        if not 0.0 <= self.gust_m_s <= 10.0:
            raise UavmapError(f"gusts: {self.gust_m_s} m/s is not 0 to 10")
        if not 0.0 <= self.tag_m <= 5.0:
            raise UavmapError(f"tag_m: {self.tag_m} m is not 0 to 5")
        if self.relief is not None and self.world:
            raise UavmapError("world: files of a world are shown on level ground only")

    def build(self, image_url_prefix: str = "sim://") -> list[SimVehicle]:
        """Return the vehicles, numbered from 1, in one world."""
        home = self.home if isinstance(self.home, Home) else Home.parse(self.home)
        world = World(self._world_spec(home))
        try:
            return [
                SimVehicle(self._vehicle_spec(number, place, home, image_url_prefix), world)
                for number, place in enumerate(self.places or self._rows(home), start=1)
            ]
        except ValueError as error:
            raise UavmapError(str(error)) from error

    def _given(self, kind: type[Conditions] | type[Equipment]) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(kind)}

    def _vehicle_spec(self, number: int, place: LatLon, home: Home, prefix: str) -> VehicleSpec:
        own: dict[str, Any] = {"system_id": number, "home": place, "home_yaw_deg": home.yaw_deg}
        own |= {"image_url_prefix": prefix, "parameters": tuple(self.parameters.items())}
        return VehicleSpec(**(self._given(Equipment) | own))

    def _world_spec(self, home: Home) -> WorldSpec:
        ground = load_ground(self.world, self.world_epsg, home.position)
        heights_m = self.pad_heights_m or [0.0] * len(self.places)
        pads = tuple(pad for pad in zip(self.places, heights_m, strict=True) if pad[1])
        own: dict[str, Any] = {"origin": home.position, "origin_amsl_m": home.amsl_m, "pads": pads}
        own |= {"patches": (*self.patches, *ground.patches), "orthophoto": ground.orthophoto}
        return WorldSpec(**(self._given(Conditions) | own))

    def _rows(self, home: Home) -> list[LatLon]:
        plane = LocalPlane(home.position)
        return [
            plane.to_wgs84(_BETWEEN_M * (i % _A_ROW), _BETWEEN_M * (i // _A_ROW))
            for i in range(self.vehicles)
        ]
