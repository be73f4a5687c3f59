"""Keyframes and links as rows of least squares."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from missions.navigation.network import (
    UNSUPPORTED_STEP_ERROR_M,
    Links,
    Numbers,
    Reals,
    ReportedErrors,
    Solution,
    Steps,
    Turns,
)

_ANYWHERE_M: Final = 1000.0  # error of a first keyframe whose satellites are not trusted
_LEAP_M: Final = 100.0  # possible jump of a reported position, once links have shown that it jumped
_KNOT_S: Final = 3.0  # between times at which scale and rotation are known; longer if needed
_MAX_KNOTS: Final = 40
# share of the variance of a process without inertia between knots: filters smooth
_BEND: Final = 0.1


@dataclass(slots=True)
class Key:
    """A keyframe; `way_m` is along all reported positions, from the first one on.

    `leapt`: the reported position jumped on the way here, as links have shown.
    """

    t_s: float
    reported: complex
    trusted: bool
    way_m: float
    leapt: bool = False


@dataclass(slots=True)
class Tie:
    """A link between two keyframes: new, believed (held), or one that does not fit (suspect)."""

    begin: int
    to: int
    moved: complex
    sigma_m: float
    state: Literal["new", "held", "suspect"] = "new"
    zoom: complex | None = None
    zoom_sigma: float = math.inf
    certain: bool = False


@dataclass(frozen=True, slots=True)
class Knots:
    """Times at which scale and rotation are unknowns; between two, both count in part.

    For each keyframe: the knot before it (`at`), the part of the one after that (`share`), and the
    variance of its turn beside theirs (`variance`).
    """

    prior: Reals
    at: Numbers
    share: Reals
    variance: Reals

    def between(self, begin: Numbers, to: Numbers, of_begin: float) -> tuple[Numbers, Reals]:
        """Return knots and shares, (n, 4): `of_begin` times the turn at `begin`, and |that| at
        `to`."""
        knots = np.stack([self.at[begin], self.at[begin] + 1, self.at[to], self.at[to] + 1], axis=1)
        a, b, half = self.share[begin], self.share[to], abs(of_begin)
        share = np.stack([of_begin * (1 - a), of_begin * a, half * (1 - b), half * b], axis=1)
        return knots, share


def knots_of(keys: Sequence[Key], errors: ReportedErrors) -> Knots:
    """Return knots that are far enough apart to be few."""
    times = np.array([key.t_s for key in keys])
    span_s = float(times[-1] - times[0])
    gap_s = max(_KNOT_S, span_s / (_MAX_KNOTS - 1))
    count = math.floor(span_s / gap_s) + 2
    along = (times - times[0]) / gap_s
    at = np.minimum(along.astype(np.intp), count - 2)
    share = along - at
    keep = math.exp(-gap_s / errors.common_s)
    step = 1.0 / (errors.common**2 * (1.0 - keep**2))
    prior = np.zeros((count, count))
    prior[0, 0] = 1.0 / errors.common**2
    before, after = np.arange(count - 1), np.arange(1, count)
    prior[before, before] += keep * keep * step
    prior[after, after] += step
    prior[before, after] = prior[after, before] = -keep * step
    bridged = _BEND * errors.common**2 * (1.0 - keep**2) * share * (1.0 - share)
    return Knots(prior, at, share, bridged)


def indices(keys: Mapping[int, Key], numbers: Iterable[int]) -> Numbers:
    """Return the places of keyframes in their order, by their numbers."""
    index = {number: k for k, number in enumerate(keys)}
    return np.array([index[number] for number in numbers], np.intp)


def turns_of(ties: Sequence[Tie], keys: Mapping[int, Key], knots: Knots) -> Turns:
    """Return the knowledge of scale and rotation: their usual spread, and zooms between
    keyframes."""
    zoomed = [tie for tie in ties if tie.zoom is not None]
    begin = indices(keys, (tie.begin for tie in zoomed))
    to = indices(keys, (tie.to for tie in zoomed))
    at, share = knots.between(begin, to, -1.0)
    zoom = np.array([tie.zoom for tie in zoomed], np.complex128)
    variance = np.array([tie.zoom_sigma**2 for tie in zoomed], np.float64)
    return Turns(
        knots.prior, at, share, zoom, variance + knots.variance[begin] + knots.variance[to]
    )


def links_of(ties: Sequence[Tie], keys: Mapping[int, Key], knots: Knots) -> Links:
    """Return the rows of links between keyframes."""
    begin, to = indices(keys, (tie.begin for tie in ties)), indices(keys, (tie.to for tie in ties))
    moved = np.array([tie.moved for tie in ties], np.complex128)
    reported = np.array([key.reported for key in keys.values()], np.complex128)
    variance = np.array([tie.sigma_m**2 for tie in ties], np.float64)
    at, share = knots.between(begin, to, 0.5)
    turned = np.abs(moved) ** 2 * (knots.variance[begin] + knots.variance[to]) / 4.0
    excess = moved - (reported[to] - reported[begin])
    return Links(begin, to, moved, excess, variance + turned, at, share)


def steps_of(keys: Sequence[Key], errors: ReportedErrors, trusted_until_s: float) -> Steps:
    """Return the steps: each error by itself, or after the one before it.

    Satellites are trusted before `trusted_until_s` at most.
    """
    satellites_m2 = errors.satellites_m**2
    keep, variance = np.zeros(len(keys)), np.full(len(keys), satellites_m2)
    before: Key | None = None
    for k, key in enumerate(keys):
        trusted = key.trusted and key.t_s < trusted_until_s
        if before is None:
            variance[k] = satellites_m2 if trusted else _ANYWHERE_M**2
        elif not trusted:
            keep[k], variance[k] = 1.0, _wander_m2(before, key, errors)
        elif before.trusted and not key.leapt:
            keep[k] = math.exp((before.t_s - key.t_s) / errors.satellites_s)
            variance[k] = satellites_m2 * (1.0 - keep[k] ** 2) + errors.pointing_m**2
        before = key
    of = np.arange(len(keys))
    return Steps(of, np.maximum(of - 1, 0), keep, variance)


def sparse_steps_of(keys: Sequence[Key], errors: ReportedErrors, every_s: float) -> Steps:
    """Return the same if satellites count only every `every_s`: their errors are then independent.

    Keyframes between are treated as if nothing supported them.
    """
    loose = steps_of(keys, errors, -math.inf)
    some = [0]
    for k, key in enumerate(keys):
        if key.t_s - keys[some[-1]].t_s >= every_s:
            some.append(k)
    of = np.array(some, np.intp)
    after = np.concatenate([of[:1], of[:-1]])
    times = np.array([keys[k].t_s for k in some])
    keep = np.exp(-np.diff(times, prepend=-math.inf) / errors.satellites_s)
    variance = errors.satellites_m**2 * (1.0 - keep**2) + errors.pointing_m**2
    return Steps(
        np.concatenate([loose.of[1:], of]), np.concatenate([loose.after[1:], after]),
        np.concatenate([loose.keep[1:], keep]), np.concatenate([loose.variance_m2[1:], variance]),
    )  # fmt: skip


def _wander_m2(before: Key, key: Key, errors: ReportedErrors) -> float:
    """Return the possible change of the error between two keyframes without support, m^2."""
    if key.leapt:
        return _LEAP_M**2
    way_m = key.way_m - before.way_m  # includes removed keyframes in between
    share = errors.reckoned_share**2 * way_m * max(way_m, errors.reckoned_over_m)
    at_rest = errors.reckoned_m_sqrt_s**2 * (key.t_s - before.t_s)
    return share + at_rest + UNSUPPORTED_STEP_ERROR_M**2


_GATE: Final = 13.8  # chi-square, two degrees of freedom, 99.9 %
_SUSPECT_S: Final = 15.0  # an unconfirmed link of this age is wrong


def judged(ties: Sequence[Tie], keys: dict[int, Key], loose: Solution, knots: Knots) -> list[Tie]:
    """Return the links that are believed, or may yet be; marks keyframes at which the position
    jumped.

    A link is believed if its misfit to the rest is no more than chance. Of others, two have to
    agree on one step, or one has to be certain.
    """
    open_ties = [tie for tie in ties if tie.state != "held"]
    off, variance = loose.misfits(links_of(open_ties, keys, knots))
    _judge_zooms([tie for tie in open_ties if tie.state == "new"], keys, loose, knots)
    suspects: list[tuple[Tie, complex]] = []
    for tie, miss, spread in zip(open_ties, off.tolist(), variance.tolist(), strict=True):
        if abs(miss) ** 2 <= _GATE * spread:
            tie.state = "held"
        elif tie.certain:
            tie.state = "held"
            _leap(keys, tie.begin, tie.to)
        else:
            tie.state = "suspect"
            suspects.append((tie, miss))
    for (a, miss_a), (b, miss_b) in itertools.combinations(suspects, 2):
        after, until = max(a.begin, b.begin), min(a.to, b.to)
        noise = a.sigma_m**2 + b.sigma_m**2 + 2.0 * UNSUPPORTED_STEP_ERROR_M**2
        # two agree on one step: the links are not wrong
        if after < until and abs(miss_a - miss_b) ** 2 <= _GATE * noise:
            a.state = b.state = "held"
            _leap(keys, after, until)
    now_s = keys[next(reversed(keys))].t_s
    return [tie for tie in ties if tie.state == "held" or now_s - keys[tie.to].t_s < _SUSPECT_S]


def _judge_zooms(ties: Sequence[Tie], keys: dict[int, Key], loose: Solution, knots: Knots) -> None:
    """Drop zooms that do not fit: nothing else can show that they were right."""
    zoomed = [tie for tie in ties if tie.zoom is not None]
    off, variance = loose.zoom_misfits(turns_of(zoomed, keys, knots))
    for tie, miss, spread in zip(zoomed, off.tolist(), variance.tolist(), strict=True):
        if abs(miss) ** 2 > _GATE * spread:
            tie.zoom = None


def _leap(keys: dict[int, Key], after: int, until: int) -> None:
    for number, key in keys.items():
        if after < number <= until:
            key.leapt = True


def bridges(number: int, mine: Iterable[Tie], others: Iterable[Tie]) -> list[Tie]:
    """Return links between the partners of keyframe `number`, by way of the best known one.

    `mine` are its links; partners that the `others` connect need no bridge.
    """
    held = sorted((tie for tie in mine if tie.state == "held"), key=lambda tie: tie.sigma_m)
    partners = [
        (tie.to, tie.moved, tie.zoom, tie)
        if tie.begin == number
        else (tie.begin, -tie.moved, None if tie.zoom is None else -tie.zoom, tie)
        for tie in held
    ]
    if not partners:
        return []
    hub, to_hub, hub_zoom, best = partners[0]
    tied = {frozenset((tie.begin, tie.to)) for tie in others}
    made = []
    for other, to_other, other_zoom, tie in partners[1:]:
        if other == hub or frozenset((other, hub)) in tied:
            continue
        sign = 1.0 if other > hub else -1.0
        sigma_m = math.hypot(best.sigma_m, tie.sigma_m)
        bridge = Tie(min(hub, other), max(hub, other), sign * (to_other - to_hub), sigma_m, "held")
        if hub_zoom is not None and other_zoom is not None:
            bridge.zoom = sign * (other_zoom - hub_zoom)
            bridge.zoom_sigma = math.hypot(best.zoom_sigma, tie.zoom_sigma)
        made.append(bridge)
    return made
