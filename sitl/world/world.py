"""The ground truth: place and drift of the region of interest, the wind and the light.

All is a function of the world's time `t_s`, which starts at 0, and of the seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from sitl.world.ground import Gray, Orthophoto, Relief, ground_tile, roi_tile
from sitl.world.tags import Carriers
from sitl.world.traffic import Intruder

# numbers that keep the streams of random numbers of one seed apart
_WIND, _LIGHT, _GROUND, _ROI = 1, 2, 3, 4
_PAD_M = 4.0


@dataclass(frozen=True, slots=True)
class Patch:
    """One polygon of the ROI, with holes; rings need not be closed.

    `rgb`: its red, green and blue in full light, over patches before it; None: gray.
    """

    polygon: tuple[LatLon, ...]
    holes: tuple[tuple[LatLon, ...], ...] = ()
    rgb: tuple[int, int, int] | None = None


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """The look of the ground, and the motion of the air.

    Attributes:
        drift_speed_m_s: The patches move rigidly towards the true bearing `drift_toward_deg`.
        gust_m_s: Standard deviation of each component of the wind around its mean.
        roi_intensity, ground_intensity: Gray levels, 0 to 255.
        texture: Standard deviation of the ground's and the ROI's pattern, gray levels.
        sensor_noise: The same of a frame's noise.
        illumination: Largest relative change of the light, which is slow.
        relief: Heights of the ground; None: a level plane.
        tag_m: Side of the marker on top of each vehicle, 0 for none; `tag_dictionary` is OpenCV's.
        traffic: Aircraft of others, which every vehicle receives once a second.
    """

    drift_speed_m_s: float = 0.0
    drift_toward_deg: float = 0.0
    wind_speed_m_s: float = 0.0
    wind_from_deg: float = 0.0
    gust_m_s: float = 0.0
    roi_intensity: float = 85.0
    ground_intensity: float = 190.0
    texture: float = 14.0
    sensor_noise: float = 4.0
    illumination: float = 0.08
    seed: int = 0
    relief: Relief | None = None
    tag_m: float = 0.0
    tag_dictionary: str = "DICT_4X4_50"
    traffic: tuple[Intruder, ...] = ()


@dataclass(frozen=True)
class WorldSpec(Conditions):
    """Conditions at a place.

    Attributes:
        origin_amsl_m: Height of the plane of the ground.
        orthophoto: Picture that the camera shows instead of a meadow, where it reaches; it does not
            drift.
        pads: Places whose surroundings have a height above the plane; cameras do not see it.
    """

    origin: LatLon
    origin_amsl_m: float
    patches: tuple[Patch, ...]
    orthophoto: Orthophoto | None = None
    pads: tuple[tuple[LatLon, float], ...] = ()


@dataclass(frozen=True, slots=True)
class _Swell:
    """A smooth, bounded wander: a sum of sines of mutually irrational periods."""

    waves: tuple[tuple[float, float, float], ...]  # amplitude, angular rate, phase

    @classmethod
    def draw(cls, rng: np.random.Generator, shortest_s: float, longest_s: float, n: int) -> _Swell:
        """Draw `n` waves of unit total variance, periods spread geometrically."""
        periods = np.geomspace(shortest_s, longest_s, n) * rng.uniform(0.9, 1.1, n)
        phases = rng.uniform(0.0, math.tau, n)
        # longer waves carry more of the energy, as in real wind and passing clouds
        power = np.sqrt(periods)
        amplitudes = np.sqrt(2.0 * power / power.sum())
        return cls(
            tuple(
                (float(a), math.tau / float(p), float(f))
                for a, p, f in zip(amplitudes, periods, phases, strict=True)
            )
        )

    @property
    def peak(self) -> float:
        """Bound of its values."""
        return sum(a for a, _, _ in self.waves)

    def at(self, t_s: float) -> float:
        """Return the value at a time; zero mean, unit variance."""
        sin, value = math.sin, 0.0
        for amplitude, rate, phase in self.waves:
            value += amplitude * sin(rate * t_s + phase)
        return value


class World:
    """A world at any time `t_s >= 0`.

    >>> world = World(WorldSpec(LatLon(48.0, 11.0), 500.0, (), wind_speed_m_s=2.0))
    >>> east, north = world.wind_at(10.0)  # from the north, so towards the south
    >>> round(east, 6) == 0, round(north, 6)
    (True, -2.0)
    """

    def __init__(self, spec: WorldSpec) -> None:
        self.spec = spec
        self.plane = LocalPlane(spec.origin)
        self.carriers = Carriers()
        """The vehicles with a marker on their top."""
        self._pads = [(*self.plane.to_plane(place), height_m) for place, height_m in spec.pads]
        toward = math.radians(spec.drift_toward_deg)
        self._drift = (
            spec.drift_speed_m_s * math.sin(toward),
            spec.drift_speed_m_s * math.cos(toward),
        )
        wind_from = math.radians(spec.wind_from_deg)
        self._wind = (
            -spec.wind_speed_m_s * math.sin(wind_from),
            -spec.wind_speed_m_s * math.cos(wind_from),
        )
        rng = np.random.default_rng([spec.seed, _WIND])
        self._gust_east = _Swell.draw(rng, 3.0, 45.0, 5)
        self._gust_north = _Swell.draw(rng, 3.0, 45.0, 5)
        self._light = _Swell.draw(np.random.default_rng([spec.seed, _LIGHT]), 40.0, 400.0, 4)
        # all vehicles of a fleet ask for the wind of the same moment
        self._wind_cache = (-1.0, self._wind)
        self.films = self._build_films()
        """Layers of paint, one over the other: a colour, None for gray, and its part of the ROI."""
        self.roi_at_rest = shapely.union_all([film for _, film in self.films])
        """The ROI at time 0; the renderer moves the camera instead of the polygon."""
        shapely.prepare(self.roi_at_rest)

    def _build_films(self) -> list[tuple[tuple[int, int, int] | None, BaseGeometry]]:
        polygons: dict[tuple[int, int, int] | None, list[Polygon]] = {}
        for patch in self.spec.patches:
            shell = [self.plane.to_plane(p) for p in patch.polygon]
            holes = [[self.plane.to_plane(p) for p in ring] for ring in patch.holes]
            polygon = Polygon(shell, holes)
            if not polygon.is_valid:
                raise ValueError(f"a patch of the world is not a simple polygon: {patch.polygon}")
            polygons.setdefault(patch.rgb, []).append(polygon)
        return [(rgb, shapely.union_all(some)) for rgb, some in polygons.items()]

    def ground_m(self, east_m: float, north_m: float) -> float:
        """Return the height of the ground above the plane."""
        for east, north, height_m in self._pads:
            if math.hypot(east_m - east, north_m - north) <= _PAD_M:
                return height_m
        relief = self.spec.relief
        return 0.0 if relief is None else relief.height_m(east_m, north_m)

    def drift_at(self, t_s: float) -> tuple[float, float]:
        """Return how far the ROI has moved since time 0, metres (true east, true north)."""
        return self._drift[0] * t_s, self._drift[1] * t_s

    def wind_at(self, t_s: float) -> tuple[float, float]:
        """Return the velocity of the air, m/s (east, north), the same everywhere."""
        gust = self.spec.gust_m_s
        if gust == 0.0:
            return self._wind
        cached_t_s, cached = self._wind_cache
        if cached_t_s != t_s:
            east, north = self._wind
            cached = (
                east + gust * self._gust_east.at(t_s),
                north + gust * self._gust_north.at(t_s),
            )
            self._wind_cache = (t_s, cached)
        return cached

    def illumination_at(self, t_s: float) -> float:
        """Return the factor on all brightness, within 1 - illumination and 1 + illumination."""
        return 1.0 + self.spec.illumination * self._light.at(t_s) / self._light.peak

    @cached_property
    def ground_texture(self) -> Gray:
        """Tile of the ground: gray levels, `sitl.world.ground.METRES_PER_PIXEL`, wraps around."""
        spec = self.spec
        return ground_tile((spec.seed, _GROUND), spec.ground_intensity, spec.texture)

    @cached_property
    def roi_texture(self) -> Gray:
        """Tile of the ROI, which drifts with the ROI."""
        spec = self.spec
        return roi_tile((spec.seed, _ROI), spec.roi_intensity, spec.texture)
