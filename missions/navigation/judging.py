"""Which links are believed, and what is left of those of a keyframe that is forgotten."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Final

from missions.navigation.network import Solution
from missions.navigation.position_error import UNEASE_M
from missions.navigation.rows import Key, Knots, Tie, links_of, turns_of

_GATE: Final = 13.8  # chi-square, two degrees of freedom, 99.9 %
_SUSPECT_S: Final = 15.0  # a link that nothing has confirmed by then is wrong


def judged(ties: Sequence[Tie], keys: dict[int, Key], loose: Solution, knots: Knots) -> list[Tie]:
    """Those that are believed, or may yet be; keyframes on whose way the told position leapt are
    marked.

    Those fit that miss what is known without them by no more than chance; of others, two have to
    say the same of one step, or one has to be certain.
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
        noise = a.sigma_m**2 + b.sigma_m**2 + 2.0 * UNEASE_M**2
        # two that say the same of one step: it is not the links that are wrong
        if after < until and abs(miss_a - miss_b) ** 2 <= _GATE * noise:
            a.state = b.state = "held"
            _leap(keys, after, until)
    now_s = keys[next(reversed(keys))].t_s
    return [tie for tie in ties if tie.state == "held" or now_s - keys[tie.to].t_s < _SUSPECT_S]


def _judge_zooms(ties: Sequence[Tie], keys: dict[int, Key], loose: Solution, knots: Knots) -> None:
    """Those that do not fit are forgotten: nothing else can show that they were right."""
    zoomed = [tie for tie in ties if tie.zoom is not None]
    off, variance = loose.zoom_misfits(turns_of(zoomed, keys, knots))
    for tie, miss, spread in zip(zoomed, off.tolist(), variance.tolist(), strict=True):
        if abs(miss) ** 2 > _GATE * spread:
            tie.zoom = None


def _leap(keys: dict[int, Key], after: int, until: int) -> None:
    """Between two keyframes the told position leapt."""
    for number, key in keys.items():
        if after < number <= until:
            key.leapt = True


def bridges(number: int, mine: Iterable[Tie], others: Iterable[Tie]) -> list[Tie]:
    """Links between the partners of a keyframe, by way of the one that is known best.

    Args:
        number: The keyframe.
        mine: Its links.
        others: All others: what they tie together needs no bridge.
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
