"""A vehicle's position by its own pictures: each is matched with earlier ones.

Some pictures are kept as keyframes. Each new one is matched with the last keyframe, and with the
oldest ones that show the same ground. Those date from the time of good satellites, and correct the
estimate when the vehicle comes back over them.

A reported position can leap, an aircraft cannot. Its last position and speed limit its reach until
the next picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from missions.navigation import Estimate, ReportedErrors, Track
from vision.own_map.ground_match import Match, compare, match, resized
from vision.own_map.ground_patch import Patch, coarser, mosaic, overlaps, side_m

_FASTEST_M_S2: Final = 8.0  # maximum acceleration of a multicopter
_NOISE_M: Final = 0.3  # error of one place against another, by attitudes
_LONGEST_S: Final = 3.0  # maximum age of a motion that limits the reach


@dataclass(frozen=True, slots=True)
class Reach:
    """Possible positions of a vehicle: a circle, its middle east and north of a keyframe."""

    east_m: float
    north_m: float
    within_m: float


@dataclass(frozen=True, slots=True)
class OwnMotion:
    """Position of the newest picture with recognised ground, and the speed there.

    Attributes:
        key: Keyframe to which the position is relative.
        velocity_m_s: East and north; None after the first picture.
        over_s: Time over which `velocity_m_s` is the mean.
    """

    t_s: float
    key: int
    east_m: float
    north_m: float
    patch: Patch
    velocity_m_s: tuple[float, float] | None = None
    over_s: float = math.inf

    def on(self, t_s: float, key: int, east_m: float, north_m: float, patch: Patch) -> OwnMotion:
        """Return the motion of the next picture, relative to the keyframe of this one."""
        over_s = t_s - self.t_s
        if key != self.key or over_s > _LONGEST_S:
            return OwnMotion(t_s, key, east_m, north_m, patch)
        velocity = (east_m - self.east_m) / over_s, (north_m - self.north_m) / over_s
        return OwnMotion(t_s, key, east_m, north_m, patch, velocity, over_s)

    def reach(self, t_s: float) -> Reach | None:
        """Return the possible positions at a time; None if unknown.

        >>> import numpy as np
        >>> ground = Patch(np.zeros((1, 1), np.int8), 0, 0, 0.2)
        >>> motion = OwnMotion(1.0, 7, 4.0, 0.0, ground, (5.0, 0.0), 0.2)
        >>> reach = motion.reach(1.2)
        >>> round(reach.east_m, 2), round(reach.within_m, 2)
        (5.0, 1.22)
        """
        on_s = t_s - self.t_s
        if self.velocity_m_s is None or on_s > _LONGEST_S:
            return None
        east, north = self.velocity_m_s
        # the mean velocity is that of the middle between both pictures
        within_m = _FASTEST_M_S2 * on_s * (on_s + self.over_s) / 2.0
        within_m += _NOISE_M * (1.0 + 2.0 * on_s / self.over_s)
        return Reach(self.east_m + east * on_s, self.north_m + north * on_s, within_m)


_KEYFRAME_SHARE: Final = 1.0 / 3.0  # of a footprint's side, from one keyframe to the next
_KEYFRAME_S: Final = 2.0
_MIN_OVERLAP: Final = 1.0 / 3.0
_OLDEST, _NEAREST = 2, 1  # number of keyframes matched with a picture, besides the last one
_MIN_SEARCH_M: Final = 0.6
_SEARCH_SIGMAS: Final = 3.5
_WIDEST_SHARE: Final = 0.5  # maximum reach of a search, as a share of a footprint's side
_LEAP_S: Final = 3.0  # maximum time for a second picture to confirm a leap
_CERTAIN_M: Final = 2.5  # maximum reach in which a match is certain
_LOST_M: Final = 1.0
_SEARCH_EVERY_S: Final = 1.0
_REACH_SIGMAS: Final = 3.7  # matches farther off would be rejected
_FARTHEST_M: Final = 60.0  # maximum reach of a search, by its duration
_COARSE_PX: Final = 25.0  # maximum reach of a search with the patches' own pixels
_FINE_M: Final = 1.5
_ALIKE: Final = 0.01  # maximum difference of sizes of pictures that are compared as they are
_MIN_ZOOM: Final = 0.02  # a difference with a larger uncertainty is no evidence
_OF_WAY: Final = 0.01  # share of the distance: heights and headings err differently in two pictures


@dataclass(frozen=True, slots=True)
class _Leap:
    """A possible leap of the reported position; other pictures have to confirm it."""

    t_s: float
    after: int
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class _CommonGround(Match):
    """The ground that a picture and a keyframe have in common.

    `moved_m` is by the mean scale and rotation of both; `certain`: within the vehicle's reach.
    """

    zoom: tuple[complex, float] | None = None
    certain: bool = False


@dataclass(slots=True)
class OwnMap:
    """The pictures that a vehicle has taken, and its position by them.

    Attributes:
        errors: Errors of reported positions.
        most_keyframes: Maximum number of keyframes; those near others are removed first.
        track: Keyframes and links: reports the disagreement, receives distrust.
    """

    errors: ReportedErrors = field(default_factory=ReportedErrors)
    most_keyframes: int = 250
    track: Track = field(init=False)
    _patches: dict[int, Patch] = field(default_factory=dict)
    _sides_m: dict[int, float] = field(default_factory=dict)
    _passing: int | None = None  # the newest picture, if it is no keyframe
    _last_t_s: float = -math.inf  # of the newest keyframe
    _searched_s: float = -math.inf  # when the whole map was last searched
    _found_anew_s: float = -math.inf
    _sigma_now_m: float = 0.0
    _leap: _Leap | None = None
    _motion: OwnMotion | None = None

    def __post_init__(self) -> None:
        self.track = Track(self.errors)

    @property
    def keyframes(self) -> int:
        """Number of kept pictures."""
        return len(self._patches)

    def add_picture(
        self, t_s: float, patch: Patch | None, reported_m: tuple[float, float], trusted: bool
    ) -> Estimate:
        """Add the next picture of the vehicle; return the error of its reported position.

        It accepts only plausible pictures (`vision.plausible`): a camera that repeats a picture
        shows a vehicle at rest while the vehicle reports movement.

        Args:
            t_s: Mission time, later than of all earlier pictures, or `ValueError`.
            patch: Visible ground, along the axes of `reported_m`; None if there is none.
            reported_m: The reported position, metres east and north.
            trusted: True for a position from satellites that there is no reason to doubt.
        """
        if self._passing is not None:
            self.track.remove(self._passing, bridged=False)
            self._passing = None
        last = next(reversed(self._patches), None)
        number = self.track.add(t_s, reported_m, trusted)
        kept = patch is not None
        if patch is not None and last is not None:
            kept = self._tie(number, patch, t_s, last)
        estimate = self.track.estimate()
        self._sigma_now_m = estimate.sigma_m
        if patch is None or not kept:
            self._passing = number
            return estimate
        if self._motion is not None and self._motion.t_s == t_s:
            self._motion = replace(self._motion, key=number, east_m=0.0, north_m=0.0)
        else:
            self._motion = OwnMotion(t_s, number, 0.0, 0.0, patch)
        self._patches[number] = patch
        self._sides_m[number] = side_m(patch)
        self._last_t_s = t_s
        self._thin_out()
        return estimate

    def _tie(self, number: int, patch: Patch, t_s: float, last: int) -> bool:
        """Link a new picture to keyframes of the same ground; return True to keep it as one."""
        if self._leap is not None and t_s - self._leap.t_s > _LEAP_S:
            self._leap = None
        leap = self._leap
        chosen = self._partners(patch, last)
        if leap is not None and leap.after in self._patches and leap.after not in chosen:
            chosen.append(leap.after)
        expected = self.track.expected_m(chosen)
        zooms = self.track.expected_zoom(chosen)
        kept = t_s - self._last_t_s >= _KEYFRAME_S
        away_m, slip = expected[0][:2], (0.0, 0.0)  # the last one is compared first
        for key, (east, north, sigma_m), zoom in zip(chosen, expected, zooms, strict=True):
            search_m = max(_MIN_SEARCH_M, _SEARCH_SIGMAS * sigma_m)
            search_m = min(search_m, _WIDEST_SHARE * side_m(patch))
            there = east + slip[0], north + slip[1]
            seen = self._find_near(key, patch, there, search_m, zoom)
            if seen is None and leap is not None:
                there = east + leap.east_m, north + leap.north_m
                seen = self._find_near(key, patch, there, search_m, zoom)
            if seen is None and key == last:
                seen = self._find_by_motion(key, patch, t_s, zoom)
                if seen is None and leap is None:
                    widest_m = _WIDEST_SHARE * side_m(patch)
                    seen = self._find_near(key, patch, (east, north), widest_m, zoom)
                if seen is not None:
                    kept, slip = True, (seen.moved_m[0] - east, seen.moved_m[1] - north)
                    if not seen.certain:
                        self._leap = leap = _Leap(t_s, key, *slip)
            if key == last:
                away_m = away_m if seen is None else seen.moved_m
                kept = kept or math.hypot(*away_m) >= _KEYFRAME_SHARE * side_m(patch)
            if seen is not None:
                if key == last:
                    self._advance(t_s, key, seen, patch)
                if kept:
                    seen = self._compared(key, patch, seen, zoom[0])
                sigma_m = self._sigma_m(seen)
                self.track.link(key, number, seen.moved_m, sigma_m, seen.zoom, certain=seen.certain)
        lost_m = _LOST_M + 2.0 * self.errors.satellites_m
        if self._sigma_now_m > lost_m and t_s - self._searched_s >= _SEARCH_EVERY_S:
            self._searched_s = t_s
            self._search_mosaic(number, patch, t_s)
        return kept or self._found_anew_s == t_s

    def _find_near(
        self, key: int, patch: Patch, there: tuple[float, float], search_m: float,
        zoom: tuple[complex, float],
    ) -> _CommonGround | None:  # fmt: skip
        """Find a keyframe's ground in a picture, near a place."""
        larger = zoom[0] if abs(zoom[0]) > _ALIKE else 0j
        found = match(
            self._patches[key], resized(patch, larger) if larger else patch, there, search_m
        )
        if found is None:
            return None
        moved = complex(*found.moved_m) * (1.0 + larger / 2.0)
        return _CommonGround((moved.real, moved.imag), found.sigma_m)

    def _find_by_motion(
        self, key: int, patch: Patch, t_s: float, zoom: tuple[complex, float]
    ) -> _CommonGround | None:
        """Find it within the vehicle's reach, by its earlier motion, whatever it reports."""
        motion = self._motion
        reach = None if motion is None or motion.key != key else motion.reach(t_s)
        if motion is None or reach is None:
            return None
        within_m = min(reach.within_m, _WIDEST_SHARE * side_m(patch))
        seen = self._find_near(key, patch, (reach.east_m, reach.north_m), within_m, zoom)
        if seen is None and motion.patch.metres_per_pixel == patch.metres_per_pixel:
            east, north = reach.east_m - motion.east_m, reach.north_m - motion.north_m
            found = match(motion.patch, patch, (east, north), within_m)
            if found is not None:
                moved_m = motion.east_m + found.moved_m[0], motion.north_m + found.moved_m[1]
                seen = _CommonGround(moved_m, math.hypot(found.sigma_m, self.errors.pointing_m))
        return None if seen is None else replace(seen, certain=reach.within_m <= _CERTAIN_M)

    def _advance(self, t_s: float, key: int, seen: _CommonGround, patch: Patch) -> None:
        before = self._motion
        if before is None or (self._leap is not None and self._leap.t_s == t_s):
            self._motion = OwnMotion(t_s, key, *seen.moved_m, patch)  # it may be of another place
        else:
            self._motion = before.on(t_s, key, *seen.moved_m, patch)

    def _compared(
        self, key: int, patch: Patch, seen: _CommonGround, zoom: complex
    ) -> _CommonGround:
        pitch_m = patch.metres_per_pixel
        moved = complex(*seen.moved_m) / pitch_m * (1.0 - zoom / 2.0)
        found = compare(self._patches[key], patch, moved, zoom)
        if found is None or found.sigma > _MIN_ZOOM:
            return seen
        at = found.moved_px * pitch_m
        return replace(
            seen,
            moved_m=(at.real, at.imag),
            sigma_m=found.sigma_px * pitch_m,
            zoom=(found.zoom, found.sigma),
        )

    def _search_mosaic(self, number: int, patch: Patch, t_s: float) -> None:
        """Search a picture on the mosaic of all others, and link it to its neighbours."""
        here = self.track.places_m()[-1]
        reach_m = min(_REACH_SIGMAS * self._sigma_now_m, _FARTHEST_M)
        wide_m, pitch_m = side_m(patch), patch.metres_per_pixel
        away = dict(zip(self.track.numbers, self.track.places_m() - here, strict=True))
        laid = [
            (other, (float(away[key][0]), float(away[key][1])))
            for key, other in self._patches.items()
            if other.metres_per_pixel == pitch_m and np.abs(away[key]).max() < reach_m + wide_m
        ]
        ground = mosaic(laid, reach_m + wide_m, pitch_m)
        pair = (ground, patch)
        if reach_m / pitch_m > _COARSE_PX:
            pair = (coarser(ground), coarser(patch))
        rough = match(*pair, (0.0, 0.0), reach_m)
        if rough is None:
            return
        found = []
        for key, other in self._patches.items():
            moved = np.array(rough.moved_m) - away[key]
            if other.metres_per_pixel != pitch_m or np.hypot(*moved) > _KEYFRAME_SHARE * wide_m:
                continue
            seen = match(other, patch, (float(moved[0]), float(moved[1])), _FINE_M)
            if seen is not None:
                found.append((key, seen))
            if len(found) == _OLDEST:
                break
        for key, seen in found:
            self.track.link(key, number, seen.moved_m, self._sigma_m(seen))
            self._found_anew_s = t_s

    def _sigma_m(self, found: Match) -> float:
        way_m = math.hypot(*found.moved_m)
        return math.hypot(found.sigma_m, math.sqrt(2.0) * self.errors.pointing_m, _OF_WAY * way_m)

    def _partners(self, patch: Patch, last: int) -> list[int]:
        """Return the last keyframe, the oldest, and the nearest ones that show the same ground."""
        where = dict(zip(self.track.numbers, self.track.places_m(), strict=True))
        away_m = np.array([where[key] for key in self._patches]) - where[self.track.newest]
        overlap = overlaps(patch, self._patches.values(), self._sides_m.values(), away_m)
        keys = list(self._patches)
        near = [k for k in range(len(keys) - 1) if overlap[k] >= _MIN_OVERLAP]
        oldest = near[:_OLDEST]
        rest = sorted(near[_OLDEST:], key=lambda k: -overlap[k])[:_NEAREST]
        return [last, *(keys[k] for k in (*oldest, *rest))]

    def _thin_out(self) -> None:
        """Remove the keyframe nearest to an older one, if there are too many."""
        if len(self._patches) <= self.most_keyframes:
            return
        where = dict(zip(self.track.numbers, self.track.places_m(), strict=True))
        keys = list(self._patches)
        places = np.array([where[key] for key in keys])
        away_m = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        away_m[np.triu_indices(len(keys))] = math.inf  # of each, only the older ones
        away_m[-_OLDEST - 1 :] = math.inf  # the newest hold what comes next
        gone = keys[int(away_m.min(axis=1).argmin())]
        del self._patches[gone], self._sides_m[gone]
        self.track.remove(gone)
