"""Where a vehicle is, by its own pictures: each is matched with those that it took before.

Some pictures are kept, as keyframes with their patches of ground. Each new one is matched with the
last of them, and with the oldest that show the same ground: those were taken while satellites were
good, and hold the estimate when it comes back over them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.navigation import Disagreement, Estimate, ToldErrors, Track
from vision.ground_match import Match, Patch, match

_KEYFRAME_SHARE: Final = 1.0 / 3.0  # of a footprint's side, from one keyframe to the next
_KEYFRAME_S: Final = 2.0
_LEAST_OVERLAP: Final = 1.0 / 3.0
_LAST_OVERLAP: Final = 0.15  # of the keyframe before, with which nothing else compares
_OLDEST, _NEAREST = 2, 1  # how many keyframes besides the last one a picture is matched with
_LEAST_SEARCH_M: Final = 0.6
_SEARCH_SIGMAS: Final = 3.5
_WIDEST_SHARE: Final = 0.5  # of a footprint's side: the farthest a place is searched
_OF_WAY: Final = 0.01  # heights and headings err differently in two pictures


@dataclass(slots=True)
class OwnMap:
    """The pictures that a vehicle has taken, and where it is by them.

    Attributes:
        errors: What told positions err by.
        most_keyframes: No more are kept; what goes is near others.
        track: Keyframes and links: what to ask for the disagreement, and to tell of distrust.
    """

    errors: ToldErrors = field(default_factory=ToldErrors)
    most_keyframes: int = 250
    track: Track = field(init=False)
    _patches: dict[int, Patch] = field(default_factory=dict)
    _sides_m: dict[int, float] = field(default_factory=dict)
    _passing: int | None = None  # the newest picture, if it is no keyframe

    def __post_init__(self) -> None:
        self.track = Track(self.errors)

    @property
    def keyframes(self) -> int:
        """How many pictures are kept."""
        return len(self._patches)

    def take(
        self, t_s: float, patch: Patch | None, told_m: tuple[float, float], trusted: bool
    ) -> Estimate:
        """The next picture of the vehicle; gives the error of its told position.

        Args:
            t_s: Mission time, later than of all pictures before.
            patch: The ground that it shows, along the axes of `told_m`; None where it shows none.
            told_m: The told position, metres east and north.
            trusted: It comes from satellites, and there is no reason to doubt them.

        Raises:
            ValueError: it is not later than the last one.
        """
        if self._passing is not None:
            self.track.remove(self._passing, bridged=False)
            self._passing = None
        last = self._last()
        number = self.track.add(t_s, told_m, trusted)
        if patch is not None and last is not None:
            self._tie(number, patch, last)
        estimate = self.track.estimate()
        if patch is None or not self._is_keyframe(t_s, patch, last):
            self._passing = number
            return estimate
        self._patches[number] = patch
        self._sides_m[number] = _side_m(patch)
        self._last_t_s = t_s
        self._thin_out()
        return estimate

    def disagreement(self) -> Disagreement:
        """How far satellites and the pictures disagree; see `Track.disagreement`."""
        return self.track.disagreement()

    _last_t_s: float = -math.inf

    def _last(self) -> int | None:
        return next(reversed(self._patches), None)

    def _is_keyframe(self, t_s: float, patch: Patch, last: int | None) -> bool:
        if last is None or t_s - self._last_t_s >= _KEYFRAME_S:
            return True
        east, north, _ = self.track.expected_m([last])[0]
        return math.hypot(east, north) >= _KEYFRAME_SHARE * _side_m(patch)

    def _tie(self, number: int, patch: Patch, last: int) -> None:
        """Match a new picture with keyframes, and link it to those that show the same ground."""
        chosen = self._partners(patch, last)
        expected = self.track.expected_m(chosen)
        side_m = _side_m(patch)
        for key, (east, north, sigma_m) in zip(chosen, expected, strict=True):
            widest_m = _WIDEST_SHARE * side_m
            search_m = min(max(_LEAST_SEARCH_M, _SEARCH_SIGMAS * sigma_m), widest_m)
            found = match(self._patches[key], patch, (east, north), search_m)
            if found is None and key == last and search_m < widest_m:
                # the told position may have leapt
                found = match(self._patches[key], patch, (east, north), widest_m)
            if found is not None:
                self.track.link(key, number, found.moved_m, self._sigma_m(found))

    def _sigma_m(self, found: Match) -> float:
        way_m = math.hypot(*found.moved_m)
        return math.hypot(found.sigma_m, math.sqrt(2.0) * self.errors.pointing_m, _OF_WAY * way_m)

    def _partners(self, patch: Patch, last: int) -> Sequence[int]:
        """The last keyframe, the oldest, and the nearest ones that show the same ground."""
        where = dict(zip(self.track.numbers, self.track.places_m(), strict=True))
        here = where[self.track.newest]
        sides_m = np.array(list(self._sides_m.values()))
        away_m = np.array([where[key] for key in self._patches]) - here
        side_m = np.minimum(sides_m, _side_m(patch))
        alike = [p.metres_per_pixel == patch.metres_per_pixel for p in self._patches.values()]
        overlap = _overlap(away_m, side_m) * np.array(alike)
        keys = list(self._patches)
        chosen = [last] if overlap[-1] >= _LAST_OVERLAP else []
        near = [k for k in range(len(keys) - 1) if overlap[k] >= _LEAST_OVERLAP]
        oldest = near[:_OLDEST]
        rest = sorted(near[_OLDEST:], key=lambda k: -overlap[k])[:_NEAREST]
        return [*chosen, *(keys[k] for k in (*oldest, *rest))]

    def _thin_out(self) -> None:
        """Forget the keyframe that is nearest to an older one, if there are too many."""
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


def _side_m(patch: Patch) -> float:
    """Of a square as large as what a patch shows."""
    return math.sqrt(patch.pixels) * patch.metres_per_pixel


def _overlap(away_m: NDArray[np.float64], side_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of a square that another one covers, so far away."""
    free = np.maximum(0.0, 1.0 - np.abs(away_m) / side_m[:, None])
    return np.asarray(free[:, 0] * free[:, 1], dtype=np.float64)
