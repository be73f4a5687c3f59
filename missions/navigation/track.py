"""The way of one vehicle: keyframes, links between them, and the error of what was told.

    told = true + error        at each keyframe, east and north
    moved (by the ground) = told movement - change of the error + common scale and rotation + noise

While satellites are trusted, the error is a Gauss-Markov process around 0. Else it moves freely, by
a share of the way: then only links to keyframes from before hold it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.navigation.network import Links, Solution, solve
from missions.navigation.rows import Key, Tie, links_of, steps_of
from missions.navigation.values import UNEASE_M, Disagreement, Estimate, ToldErrors

_GATE: Final = 13.8  # chi-square, two degrees of freedom, 99.9 %
_SUSPECT_S: Final = 15.0  # a link that nothing has confirmed by then is wrong
_LEAPS_S: Final = 60.0  # for so long a leap is held against satellites
_BEGINNINGS_S: Final = (6.0, 15.0, 40.0, 80.0, 160.0)  # since when satellites might lie


@dataclass(slots=True)
class Track:
    """Keyframes of one vehicle in the order of their time, and the links between them.

    >>> track = Track()
    >>> for k in range(40):  # dead reckoning from the twentieth on, too long by 0.2 m a step
    ...     key = track.add(float(k), (5.0 * k + max(0.0, 0.2 * (k - 19)), 0.0), trusted=k < 20)
    ...     if k:
    ...         track.link(key - 1, key, (5.0, 0.0), 0.05)
    >>> 2.0 < track.estimate().error_m[0] < 5.0
    True
    """

    errors: ToldErrors = field(default_factory=ToldErrors)
    _keys: dict[int, Key] = field(default_factory=dict)
    _links: list[Tie] = field(default_factory=list)
    _next: int = 0
    _lying: bool = False
    _way_m: float = 0.0
    _told: complex | None = None
    _loose: Solution | None = None

    # --- what is told -----------------------------------------------------------------------
    def add(self, t_s: float, told_m: tuple[float, float], trusted: bool) -> int:
        """A keyframe, later than all others; gives its number.

        Args:
            t_s: Mission time.
            told_m: The told position, metres east and north.
            trusted: It comes from satellites, and there is no reason to doubt them.

        Raises:
            ValueError: it is not later than the newest one.
        """
        if self._keys and t_s <= self._keys[self.newest].t_s:
            raise ValueError(f"a keyframe at {t_s:g} s after one at {self._newest.t_s:g} s")
        number, self._next = self._next, self._next + 1
        told = complex(*told_m)
        self._way_m += 0.0 if self._told is None else abs(told - self._told)
        self._told = told
        self._keys[number] = Key(t_s, told, trusted and not self._lying, self._way_m)
        self._loose = None
        return number

    def link(self, begin: int, to: int, moved_m: tuple[float, float], sigma_m: float) -> None:
        """The ground says that from one keyframe to another the camera moved so far.

        Args:
            begin: Number of a keyframe.
            to: Number of a later one.
            moved_m: East and north.
            sigma_m: Standard deviation in one direction, above 0.

        Raises:
            ValueError: there is no such keyframe, or they are not in order.
        """
        if begin not in self._keys or to not in self._keys or begin >= to or not sigma_m > 0.0:
            raise ValueError(f"no link from keyframe {begin} to {to} with sigma {sigma_m:g} m")
        self._links.append(Tie(begin, to, complex(*moved_m), sigma_m))

    def distrust(self, since_s: float) -> None:
        """Satellites have lied since then: no position from then on is held to be near the truth.

        That holds for keyframes to come, too, until `trust_again`.
        """
        for key in self._keys.values():
            key.trusted = key.trusted and key.t_s < since_s
        self._lying = True
        self._loose = None

    def trust_again(self) -> None:
        """From the next keyframe on satellites are believed, where it is told so."""
        self._lying = False

    def remove(self, number: int, *, bridged: bool = True) -> None:
        """Forget a keyframe; what it tied together stays tied, where it is to be bridged."""
        del self._keys[number]
        mine = [link for link in self._links if number in (link.begin, link.to)]
        self._links = [link for link in self._links if number not in (link.begin, link.to)]
        held = sorted((link for link in mine if link.state == "held"), key=lambda k: k.sigma_m)
        if bridged and len(held) > 1:
            self._bridge(number, held)
        self._loose = None

    def _bridge(self, number: int, held: Iterable[Tie]) -> None:
        """Links between the partners of a keyframe, by way of the one that is known best."""
        partners = [
            (link.to, link.moved, link.sigma_m)
            if link.begin == number
            else (link.begin, -link.moved, link.sigma_m)
            for link in held
        ]
        hub, to_hub, hub_sigma_m = partners[0]
        tied = {frozenset((link.begin, link.to)) for link in self._links}
        for other, to_other, sigma_m in partners[1:]:
            if other == hub or frozenset((other, hub)) in tied:
                continue
            begin, to, moved = hub, other, to_other - to_hub
            if begin > to:
                begin, to, moved = to, begin, -moved
            self._links.append(Tie(begin, to, moved, math.hypot(hub_sigma_m, sigma_m), "held"))

    # --- what follows -----------------------------------------------------------------------
    @property
    def newest(self) -> int:
        """The number of the newest keyframe."""
        return next(reversed(self._keys))

    @property
    def numbers(self) -> tuple[int, ...]:
        """Of all keyframes, oldest first."""
        return tuple(self._keys)

    @property
    def links(self) -> int:
        """How many links are believed."""
        return sum(link.state == "held" for link in self._links)

    @property
    def _newest(self) -> Key:
        return self._keys[self.newest]

    def expected_m(self, numbers: Iterable[int]) -> list[tuple[float, float, float]]:
        """From each of these keyframes to the newest: east, north, and the standard deviation.

        By links, and by what is told where there are none; trusted or not.
        """
        loose = self._settled()
        index = {number: k for k, number in enumerate(self._keys)}
        told, last = self._newest.told, len(self._keys) - 1
        begin = np.array([index[number] for number in numbers], np.intp)
        told_m = told - np.array([self._keys[number].told for number in numbers], np.complex128)
        nothing = np.zeros(len(begin), np.complex128)
        # the true movement is told - (e_to - e_begin); common unknowns turn what the ground shows
        links = Links(
            begin, np.full(len(begin), last), told_m, nothing, np.full(len(begin), 1e-6)
        )  # fmt: skip
        off, variance = loose.misfits(links)
        return [
            (float(place.real), float(place.imag), math.sqrt(spread))
            for place, spread in zip(told_m - off, variance, strict=True)
        ]

    def places_m(self) -> NDArray[np.float64]:
        """Where each keyframe truly was, east and north, by links more than by satellites.

        Shape (n, 2), oldest first. Good to find what is near; `estimate` says where it is.
        """
        told = np.array([key.told for key in self._keys.values()])
        places = told - self._settled().errors_m
        return np.column_stack([places.real, places.imag])

    def estimate(self) -> Estimate:
        """The error of the newest told position.

        Raises:
            ValueError: there is no keyframe.
        """
        if not self._keys:
            raise ValueError("a track without keyframes has no estimate")
        self._settle()
        found = self._solve(trusted_until_s=math.inf)
        error, last = found.errors_m[-1], len(self._keys) - 1
        sigma_m = math.sqrt(found.variance_of(last) + self.errors.pointing_m**2)
        return Estimate(
            (float(error.real), float(error.imag)), sigma_m, found.common.real, found.common.imag
        )

    def disagreement(self) -> Disagreement:
        """How far satellites may be off, if they may have begun to lie at any time.

        Several beginnings are tried, from some seconds to some minutes ago: positions from then on
        are held by links alone. The one with the greatest certain error is told.
        """
        self._settle()
        now_s, first_s = self._newest.t_s, next(iter(self._keys.values())).t_s
        last, worst = len(self._keys) - 1, None
        for ago_s in _BEGINNINGS_S:
            begin_s = now_s - ago_s
            if begin_s <= first_s:
                break
            found = self._solve(trusted_until_s=begin_s)
            error = found.errors_m[-1]
            sigma_m = math.sqrt(found.variance_of(last) + self.errors.pointing_m**2)
            told = Disagreement((float(error.real), float(error.imag)), sigma_m, begin_s)
            if worst is None or told.least_m > worst[0].least_m:
                worst = told, found
        leap_m, leapt_s = self._greatest_leap()
        if worst is None:
            return Disagreement((0.0, 0.0), math.inf, min(now_s, leapt_s), leap_m)
        told, found = worst
        since_s = min(self._began_s(found, told.since_s), leapt_s)
        return Disagreement(told.error_m, told.sigma_m, since_s, leap_m)

    def _greatest_leap(self) -> tuple[float, float]:
        """How far the told position leapt in the last minute, and when; 0 and never."""
        keys, errors = list(self._keys.values()), self._settled().errors_m
        leaps = [
            (float(abs(errors[k] - errors[k - 1])), keys[k].t_s)
            for k in range(1, len(keys))
            if keys[k].leapt and keys[-1].t_s - keys[k].t_s < _LEAPS_S
        ]
        return max(leaps, default=(0.0, math.inf))

    def _began_s(self, found: Solution, earliest_s: float) -> float:
        """The last time at which the told position was still as good as satellites are."""
        usual_m = self.errors.satellites_m
        began_s = earliest_s
        for key, error in zip(self._keys.values(), found.errors_m, strict=True):
            if key.t_s >= earliest_s and abs(error) <= usual_m:
                began_s = key.t_s
        return max(earliest_s, began_s - 5.0)

    # --- the equations ----------------------------------------------------------------------
    def _settle(self) -> None:
        """See to it that each link is believed, or not."""
        if any(link.state == "new" for link in self._links):
            self._judge(self._loose or self._solve(trusted_until_s=-math.inf))
            self._loose = None

    def _settled(self) -> Solution:
        """The loose solution, once new links are believed or not."""
        self._settle()
        if self._loose is None:
            self._loose = self._solve(trusted_until_s=-math.inf)
        return self._loose

    def _judge(self, loose: Solution) -> None:
        """Which links fit what is known without them; which show that the told position leapt."""
        now_s = self._newest.t_s
        open_links = [link for link in self._links if link.state != "held"]
        off, variance = loose.misfits(links_of(open_links, self._keys))
        suspects: list[tuple[Tie, complex]] = []
        for link, miss, spread in zip(open_links, off.tolist(), variance.tolist(), strict=True):
            if abs(miss) ** 2 <= _GATE * spread:
                link.state = "held"
            else:
                link.state = "suspect"
                suspects.append((link, miss))
        for (a, miss_a), (b, miss_b) in itertools.combinations(suspects, 2):
            after, until = max(a.begin, b.begin), min(a.to, b.to)
            noise = a.sigma_m**2 + b.sigma_m**2 + 2.0 * UNEASE_M**2
            # two that say the same of one step: it is not the links that are wrong
            if after < until and abs(miss_a - miss_b) ** 2 <= _GATE * noise:
                a.state = b.state = "held"
                self._leap(after, until)
        self._links = [
            link
            for link in self._links
            if link.state == "held" or now_s - self._keys[link.to].t_s < _SUSPECT_S
        ]

    def _leap(self, after: int, until: int) -> None:
        """Between two keyframes the told position leapt."""
        for number, key in self._keys.items():
            if after < number <= until:
                key.leapt = True

    def _solve(self, trusted_until_s: float) -> Solution:
        held = [link for link in self._links if link.state == "held"]
        steps = steps_of(list(self._keys.values()), self.errors, trusted_until_s)
        return solve(len(self._keys), steps, links_of(held, self._keys), self.errors.common)
