"""The way of one vehicle: keyframes, links between them, and the error of what was reported.

    reported = true + error        at each keyframe, east and north
    moved (by the ground) = reported movement - change of the error + scale and rotation + noise
    zoom (by the ground)  = change of scale and rotation + noise

While satellites are trusted, the error is a Gauss-Markov process around 0. Else it moves freely, by
a share of the way: then only links to keyframes from before hold it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.navigation.network import (
    Disagreement,
    Estimate,
    Links,
    ReportedErrors,
    Solution,
    Turns,
    solve,
)
from missions.navigation.rows import (
    Key,
    Knots,
    Tie,
    bridges,
    indices,
    judged,
    knots_of,
    links_of,
    sparse_steps_of,
    steps_of,
    turns_of,
)

LATEST_S: Final = 30.0
"""Age up to which an unnoticed false position is possible, s."""

_RATIOS: Final = (0.3, 0.45, 0.7, 1.0, 1.45)  # to the assumption; without any evidence, about 1
_EVERY_S: Final = 10.0  # filters smooth: within seconds all satellites look steady
_SPREAD: Final = 0.7  # of the logarithm of a receiver's deviation from that
_FEWEST: Final = 10
_MOST: Final = 80  # keyframes, the newest of those that count


def learned_m(keys: dict[int, Key], ties: Sequence[Tie], errors: ReportedErrors) -> float:
    """Return the standard deviation of satellites in one direction: at most that of `errors`.

    It is the mean over several candidates, weighted by their probability given pictures and
    satellites. Keyframes count from the first to the first untrusted one, without the newest: else
    a slow false drift would be taken for noise.
    """
    until_s = keys[next(reversed(keys))].t_s - LATEST_S if keys else 0.0
    calm = list(takewhile(lambda item: item[1].trusted and item[1].t_s <= until_s, keys.items()))
    if len(calm) < _FEWEST:
        return errors.satellites_m
    some = dict(calm[-_MOST:])
    among = [tie for tie in ties if tie.begin in some and tie.to in some]
    chain = list(some.values())
    knots = knots_of(chain, errors)
    links, turns = links_of(among, some, knots), turns_of(among, some, knots)
    sigmas_m = np.array(_RATIOS) * errors.satellites_m
    weights = []
    for ratio, sigma_m in zip(_RATIOS, sigmas_m.tolist(), strict=True):
        steps = sparse_steps_of(chain, replace(errors, satellites_m=sigma_m), _EVERY_S)
        found = solve(len(chain), steps, links, turns, weighed=True)
        weights.append(found.evidence - (math.log(ratio) / _SPREAD) ** 2 / 2.0)
    shares = np.exp(np.array(weights) - max(weights))
    sigma_m = math.sqrt(float(shares @ sigmas_m**2) / float(shares.sum()))
    return min(sigma_m, errors.satellites_m)


_LEARN_S: Final = 8.0  # between two estimates of the quality of satellites
_LEAPS_S: Final = 60.0  # time for which a leap counts against satellites
_BEGINNINGS_S: Final = (6.0, 15.0, 40.0, 80.0, 160.0)  # possible beginnings of false positions


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

    errors: ReportedErrors = field(default_factory=ReportedErrors)
    _keys: dict[int, Key] = field(default_factory=dict)
    _links: list[Tie] = field(default_factory=list)
    _next: int = 0
    _lying: bool = False
    _way_m: float = 0.0
    _reported: complex | None = None
    _satellites_m: float | None = None
    _learnt_s: float = -math.inf
    _loose: Solution | None = None

    # --- evidence --------------------------------------------------------------------------
    def add(self, t_s: float, reported_m: tuple[float, float], trusted: bool) -> int:
        """Add a keyframe at a reported position, metres east and north; return its number.

        `trusted`: it comes from satellites, and there is no reason to doubt them. Raises ValueError
        if it is not later than the newest one.
        """
        if self._keys and t_s <= self._keys[self.newest].t_s:
            raise ValueError(f"a keyframe at {t_s:g} s after one at {self._newest.t_s:g} s")
        number, self._next = self._next, self._next + 1
        reported = complex(*reported_m)
        self._way_m += 0.0 if self._reported is None else abs(reported - self._reported)
        self._reported = reported
        self._keys[number] = Key(t_s, reported, trusted and not self._lying, self._way_m)
        self._loose = None
        return number

    def link(
        self,
        begin: int,
        to: int,
        moved_m: tuple[float, float],
        sigma_m: float,
        zoom: tuple[complex, float] | None = None,
        *,
        certain: bool = False,
    ) -> None:
        """Add the movement from one keyframe to a later one, as the ground shows it.

        Args:
            begin: Number of a keyframe.
            to: Number of a later one.
            moved_m: East and north, by the mean scale and rotation of both pictures.
            sigma_m: Standard deviation in one direction, above 0.
            zoom: Share by which the later picture shows the ground larger (imaginary: its turn,
                counter-clockwise, rad), and its standard deviation.
            certain: The movement fits those before; if something is wrong, then the position.

        Raises ValueError for foreign keyframes, or for two that are not in order.
        """
        if begin not in self._keys or to not in self._keys or begin >= to or not sigma_m > 0.0:
            raise ValueError(f"no link from keyframe {begin} to {to} with sigma {sigma_m:g} m")
        tie = Tie(begin, to, complex(*moved_m), sigma_m, certain=certain)
        if zoom is not None:
            tie.zoom, tie.zoom_sigma = zoom
        self._links.append(tie)

    def distrust(self, since_s: float) -> None:
        """Distrust satellites from `since_s` until `trust_again`."""
        for key in self._keys.values():
            key.trusted = key.trusted and key.t_s < since_s
        self._lying = True
        self._loose = None

    def trust_again(self) -> None:
        """Trust satellites again, from the next keyframe on."""
        self._lying = False

    def remove(self, number: int, *, bridged: bool = True) -> None:
        """Remove a keyframe; with `bridged`, its neighbours stay connected."""
        after = next((k for k in self._keys if k > number), None)
        if after is not None and self._keys[number].leapt:
            self._keys[after].leapt = True
        del self._keys[number]
        mine = [link for link in self._links if number in (link.begin, link.to)]
        self._links = [link for link in self._links if number not in (link.begin, link.to)]
        if bridged:
            self._links += bridges(number, mine, self._links)
        self._loose = None

    # --- what follows -----------------------------------------------------------------------
    @property
    def newest(self) -> int:
        """The number of the newest keyframe."""
        return next(reversed(self._keys))

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of all keyframes, oldest first."""
        return tuple(self._keys)

    @property
    def links(self) -> int:
        """Number of believed links."""
        return sum(link.state == "held" for link in self._links)

    @property
    def _newest(self) -> Key:
        return self._keys[self.newest]

    def expected_m(self, numbers: Iterable[int]) -> list[tuple[float, float, float]]:
        """Return the way from each keyframe to the newest: east, north, standard deviation.

        It is by links, and by reported positions where there are none.
        """
        loose, begin = self._settled(), indices(self._keys, numbers)
        reported, last = self._newest.reported, len(self._keys) - 1
        reported_m = reported - np.array(
            [self._keys[number].reported for number in numbers], np.complex128
        )
        nothing, variance = np.zeros(len(begin), np.complex128), np.full(len(begin), 1e-6)
        # the true movement is the reported one - (e_to - e_begin); the ground shows it turned and
        # scaled
        to = np.full(len(begin), last)
        at, share = self._knots().between(begin, to, 0.5)
        links = Links(begin, to, reported_m, nothing, variance, at, share)
        off, variance = loose.misfits(links)
        return [
            (float(place.real), float(place.imag), math.sqrt(spread))
            for place, spread in zip(reported_m - off, variance, strict=True)
        ]

    def expected_zoom(self, numbers: Iterable[int]) -> list[tuple[complex, float]]:
        """Return the zoom of the newest picture beside each of these, with its standard
        deviation."""
        loose, knots = self._settled(), self._knots()
        begin = indices(self._keys, numbers)
        at, share = knots.between(begin, np.full(len(begin), len(self._keys) - 1), -1.0)
        nothing = np.zeros(len(begin))
        asked = Turns(knots.prior, at, share, nothing.astype(np.complex128), nothing)
        off, variance = loose.zoom_misfits(asked)
        return [
            (-zoom, math.sqrt(spread))
            for zoom, spread in zip(off.tolist(), variance.tolist(), strict=True)
        ]

    def places_m(self) -> NDArray[np.float64]:
        """Return places of the keyframes, (n, 2), oldest first, by links more than by satellites.

        They are good for finding near ones; `estimate` gives the present position.
        """
        reported = np.array([key.reported for key in self._keys.values()])
        places = reported - self._settled().errors_m
        return np.column_stack([places.real, places.imag])

    def estimate(self) -> Estimate:
        """Return the error of the newest reported position. Raises ValueError without a
        keyframe."""
        if not self._keys:
            raise ValueError("a track without keyframes has no estimate")
        self._settle()
        self._learn()
        found = self._solve(trusted_until_s=math.inf)
        error, last = found.errors_m[-1], len(self._keys) - 1
        sigma_m = math.sqrt(found.variance_of(last) + self.errors.pointing_m**2)
        knots = self._knots()
        share = knots.share[-1]
        turn = complex((1.0 - share) * found.turns[-2] + share * found.turns[-1])
        return Estimate((float(error.real), float(error.imag)), sigma_m, turn.real, turn.imag)

    @property
    def satellites_m(self) -> float:
        """Error of satellites, as learned so far, m."""
        return self._satellites_m or self.errors.satellites_m

    def disagreement(self) -> Disagreement:
        """Return the possible error of satellites, if they may have begun to be false at any time.

        Of several beginnings, from which on positions are held by links alone, the one with the
        largest certain error counts.
        """
        self._settle()
        now_s, first_s = self._newest.t_s, next(iter(self._keys.values())).t_s
        last, worst = len(self._keys) - 1, None
        if last > 0 and self._by_one_picture():
            last -= 1
        for ago_s in _BEGINNINGS_S:
            begin_s = now_s - ago_s
            if begin_s <= first_s:
                break
            found = self._solve(trusted_until_s=begin_s)
            error = found.errors_m[last]
            sigma_m = math.sqrt(found.variance_of(last) + self.errors.pointing_m**2)
            reported = Disagreement((float(error.real), float(error.imag)), sigma_m, begin_s)
            if worst is None or reported.least_m > worst[0].least_m:
                worst = reported, found
        leap_m, leapt_s = self._greatest_leap()
        if worst is None:
            return Disagreement((0.0, 0.0), math.inf, min(now_s, leapt_s), leap_m)
        reported, found = worst
        since_s = min(self._began_s(found, reported.since_s), leapt_s)
        return Disagreement(reported.error_m, reported.sigma_m, since_s, leap_m)

    def _greatest_leap(self) -> tuple[float, float]:
        """Return the last minute's largest jump of the reported position, and its time; 0 and
        never."""
        keys, errors = list(self._keys.values()), self._settled().errors_m
        leaps = [
            (float(abs(errors[k] - errors[k - 1])), keys[k].t_s)
            for k in range(1, len(keys) - self._by_one_picture())
            if keys[k].leapt and keys[-1].t_s - keys[k].t_s < _LEAPS_S
        ]
        return max(leaps, default=(0.0, math.inf))

    def _by_one_picture(self) -> bool:
        """Return whether a single picture shows that the newest reported position jumped."""
        mine = sum(link.to == self.newest and link.state == "held" for link in self._links)
        return self._newest.leapt and mine < 2

    def _began_s(self, found: Solution, earliest_s: float) -> float:
        """Return the last time at which the reported position was as good as satellites are, s."""
        usual_m = self.satellites_m
        began_s = earliest_s
        for key, error in zip(self._keys.values(), found.errors_m, strict=True):
            if key.t_s >= earliest_s and abs(error) <= usual_m:
                began_s = key.t_s
        return max(earliest_s, began_s - 5.0)

    # --- the equations ----------------------------------------------------------------------
    def _settle(self) -> None:
        if any(link.state == "new" for link in self._links):
            loose = self._loose or self._solve(trusted_until_s=-math.inf)
            self._links = judged(self._links, self._keys, loose, self._knots())
            self._loose = None

    def _settled(self) -> Solution:
        """Return the loose solution, once new links are believed or not."""
        self._settle()
        if self._loose is None:
            self._loose = self._solve(trusted_until_s=-math.inf)
        return self._loose

    def _solve(self, trusted_until_s: float) -> Solution:
        held = [link for link in self._links if link.state == "held"]
        errors = replace(self.errors, satellites_m=self.satellites_m)
        steps = steps_of(list(self._keys.values()), errors, trusted_until_s)
        knots = self._knots()
        turns = turns_of(held, self._keys, knots)
        return solve(len(self._keys), steps, links_of(held, self._keys, knots), turns)

    def _learn(self) -> None:
        """Learn every few seconds how good satellites are."""
        if self._newest.t_s - self._learnt_s < _LEARN_S or self._lying:
            return
        self._learnt_s = self._newest.t_s
        held = [link for link in self._links if link.state == "held"]
        self._satellites_m = learned_m(self._keys, held, self.errors)

    def _knots(self) -> Knots:
        return knots_of(list(self._keys.values()), self.errors)
