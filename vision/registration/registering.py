"""From views with tags to refined poses: pairs, nets, adjustment, and the views left as tagged."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from vision.registration.adjustment import HEIGHT, HUBER_PX, YAW, Solution, Tags, Ties, adjust
from vision.registration.ground_plane import Cameras, Relief, tilted_axes
from vision.registration.matching import (
    Pair,
    apart_m,
    candidates,
    joined,
    pair_medians_px,
    tie_points,
    transfer_px,
)
from vision.registration.net import (
    MAX_SCALE_SIGMA,
    MAX_YAW_SIGMA_RAD,
    PlacedNet,
    chained,
    components,
    place_net,
)
from vision.registration.normal_equations import sigmas
from vision.registration.views import (
    CONTRADICTED,
    NO_HEADING,
    NO_OVERLAP,
    NO_SCALE,
    NO_TEXTURE,
    SIDEWAYS,
    Agreement,
    Floats,
    Measured,
    Net,
    Refined,
    Registration,
    View,
)

MAX_TILT: Final = 1.2
"""Maximum tagged tilt of a registered view, a tangent (50 degrees)."""

MAX_RESIDUAL_PX: Final = 4.0
"""Maximum median miss of tie points of a refined view, pixels."""

_WRONG_PAIR_PX = 6.0  # pairs that miss by more than this, and than others, are no overlaps
_WRONG_PAIR_TIMES = 4.0
_MENDS = 3  # number of times that a net is begun anew without its wrong pairs
_MIN_POSITION_SIGMA_M = 0.5

_FEW_POINTS = 40


Match = Callable[[tuple[int, int]], Pair | None]
Many = Callable[[Match, Iterable[tuple[int, int]]], Iterable[Pair | None]]
"""A function like `map`: the answers in the items' order, perhaps from threads."""


def register(
    views: Sequence[View],
    progress: Callable[[int, int], None] = lambda done, all_: None,
    many: Many = map,
    relief: Relief | None = None,
) -> Registration:
    """Refine the poses of views by their overlaps.

    The order of the views and `many` do not change the result.

    Args:
        progress: Receives the numbers of examined and of all possible overlaps.
        many: Examines overlaps, one after the other or several at once.
        relief: The ground, if it is known not to be flat.
    """
    order = sorted(range(len(views)), key=lambda k: views[k].name)
    found = _Registering([views[k] for k in order], relief)
    found.run(progress, many)
    back = sorted(range(len(order)), key=lambda at: order[at])
    nets = [replace(n, members=tuple(sorted(order[m] for m in n.members))) for n in found.nets]
    return Registration(
        tuple(found.refined[k] for k in back),
        tuple(found.left[k] for k in back),
        tuple(nets),
        found.agreement(found.as_tagged),
        found.agreement(found.as_refined),
    )


class _Registering:
    """A registration under way; views are sorted by name."""

    def __init__(self, views: list[View], relief: Relief | None) -> None:
        self.views, self.relief = views, relief
        self.refined: list[Refined | None] = [None] * len(views)
        self.left: list[str | None] = [NO_OVERLAP] * len(views)
        self.nets: list[Net] = []
        self.as_tagged: list[tuple[Cameras, Pair]] | None = []
        self.as_refined: list[tuple[Cameras, Pair]] = []

    def run(self, progress: Callable[[int, int], None], many: Many) -> None:
        """Find the pairs, and adjust their nets."""
        usable = [k for k, v in enumerate(self.views) if math.hypot(*v.tilt) <= MAX_TILT]
        for k in set(range(len(self.views))) - set(usable):
            self.left[k] = SIDEWAYS
        for k in usable:
            if len(self.views[k].features.points) < _FEW_POINTS:
                self.left[k] = NO_TEXTURE
        chosen = [self.views[k] for k in usable]
        possible = candidates(chosen)

        def matched(at: tuple[int, int]) -> Pair | None:
            i, j = at
            return tie_points(chosen[i], chosen[j], (usable[i], usable[j]))

        pairs = []
        for done, pair in enumerate(many(matched, possible), start=1):
            if pair is not None:
                pairs.append(pair)
            progress(done, len(possible))
        self._nets(usable, pairs, _MENDS)

    def _nets(self, members: list[int], pairs: list[Pair], mends: int) -> None:
        place = {k: at for at, k in enumerate(members)}
        links = [(place[p.first], place[p.second]) for p in pairs]
        for group in components(len(members), links):
            if len(group) > 1:
                inside = {members[k] for k in group}
                self._net(sorted(inside), [p for p in pairs if p.first in inside], mends)

    def _net(self, members: list[int], pairs: list[Pair], mends: int) -> None:
        views = [self.views[k] for k in members]
        place = {k: at for at, k in enumerate(members)}
        local = [replace(p, first=place[p.first], second=place[p.second]) for p in pairs]
        on_ground = place_net(views, *chained(views, local))
        if on_ground.yaw_sigma_rad > MAX_YAW_SIGMA_RAD:
            return self._leave(members, NO_HEADING)
        if on_ground.scale_sigma > MAX_SCALE_SIGMA:
            return self._leave(members, NO_SCALE)
        tags, start, cameras = _start(views, on_ground, self.relief)
        solution = adjust(start, Ties.from_pairs(local), tags, HUBER_PX[:-1])
        misses = pair_medians_px(solution.cameras, local)
        limit = max(_WRONG_PAIR_PX, _WRONG_PAIR_TIMES * float(np.median(misses)))
        good = [p for p, miss in zip(pairs, misses, strict=True) if miss <= limit]
        if len(good) < len(pairs) and mends > 0:
            self._leave(members, CONTRADICTED)
            return self._nets(members, good, mends - 1)
        solution = adjust(solution.cameras, Ties.from_pairs(local), tags, HUBER_PX[-2:])
        self._keep(members, local, on_ground, solution, tags, cameras)
        return None

    def _leave(self, members: list[int], why: str) -> None:
        for k in members:
            self.left[k] = why

    def _keep(
        self,
        members: list[int],
        local: list[Pair],
        on_ground: PlacedNet,
        solution: Solution,
        tags: Tags,
        cameras: list[str],
    ) -> None:
        ties = [0] * len(members)
        misses: list[list[Floats]] = [[] for _ in members]
        for p in local:
            missed = transfer_px(solution.cameras, p)
            for at in (p.first, p.second):
                ties[at] += len(p.in_first)
                misses[at].append(missed)
        assert solution.normal is not None
        deviations = sigmas(solution.normal)
        for at, k in enumerate(members):
            off = joined(misses[at])
            residual_px = float(np.median(off)) if len(off) else math.inf
            if residual_px > MAX_RESIDUAL_PX:
                self.left[k] = CONTRADICTED
                continue
            self.left[k] = None
            self.refined[k] = Refined(
                solution.cameras.centre_m[at],
                solution.cameras.axes[at],
                float(solution.cameras.focal_px[solution.cameras.groups[at]]),
                float(np.hypot(*deviations[at, :2]) / math.sqrt(2.0)),
                float(deviations[at, 2]),
                float(deviations[at, 5]),
                len(self.nets),
                bool(on_ground.turned[at]),
                ties[at],
                residual_px,
            )
        focal = solution.cameras.focal_px / tags.focal_px
        self.nets.append(
            Net(
                tuple(k for k in members if self.refined[k] is not None),
                len(local),
                dict(zip(cameras, focal.tolist(), strict=True)),
                (float(solution.slope[0]), float(solution.slope[1])),
                float(solution.shared[HEIGHT]),
                float(solution.shared[YAW]),
                on_ground.position_sigma_m,
            )
        )
        kept = [self.refined[k] is not None for k in members]
        held = [p for p in local if kept[p.first] and kept[p.second]]
        tagged = _as_tagged(tags, solution.cameras)
        if tagged is None:
            self.as_tagged = None
        elif self.as_tagged is not None:
            self.as_tagged += [(tagged, p) for p in held]
        self.as_refined += [(solution.cameras, p) for p in held]

    @staticmethod
    def agreement(pairs: list[tuple[Cameras, Pair]] | None) -> Agreement | None:
        """Return the agreement of held tie points; None if there are none, or poses are missing."""
        metres = joined([apart_m(cameras, pair) for cameras, pair in pairs or ()])
        pixels = joined([transfer_px(cameras, pair) for cameras, pair in pairs or ()])
        if not len(metres):
            return None
        return Agreement(
            len(metres),
            float(np.median(metres)),
            float(np.quantile(metres, 0.9)),
            float(np.median(pixels)),
            float(np.quantile(pixels, 0.9)),
        )


def _start(
    views: list[View], net: PlacedNet, relief: Relief | None
) -> tuple[Tags, Cameras, list[str]]:
    """Return the tags of a net as arrays, its first poses, and its cameras' names."""
    cameras = sorted({v.camera for v in views})
    groups = np.array([cameras.index(v.camera) for v in views])
    focal = np.array(
        [np.median([v.focal_px.value for v in views if v.camera == c]) for c in cameras]
    )
    sigma = [
        min(v.focal_px.sigma / v.focal_px.value for v in views if v.camera == c) for c in cameras
    ]
    yaw = -np.angle(net.scale)
    flip = np.where(net.turned, -1.0, 1.0)
    tilt = np.array([v.tilt for v in views], float) * flip[:, None]
    found_m = math.inf  # if geotags agree with the net better than their tags state
    if net.position_sigma_m is not None:
        found_m = max(net.position_sigma_m, _MIN_POSITION_SIGMA_M)
    height_m, height_sigma_m = _measured([v.height_m for v in views])
    yaw_rad, yaw_sigma_rad = _measured([v.yaw_rad for v in views])
    tags = Tags(
        place_m=np.array([[v.east_m, v.north_m] for v in views]),
        place_sigma_m=np.array([min(v.position_sigma_m, found_m) for v in views]),
        height_m=height_m,
        height_sigma_m=height_sigma_m,
        yaw_rad=yaw_rad + np.where(net.turned, math.pi, 0.0),
        yaw_sigma_rad=yaw_sigma_rad,
        tilt=tilt,
        tilt_sigma=np.array([v.tilt_sigma for v in views]),
        focal_px=focal,
        focal_sigma=np.array(sigma),
    )
    height = np.abs(net.scale) * np.array([v.focal_px.value for v in views])
    place = np.stack([net.place.real, net.place.imag], axis=1)
    level = np.zeros(len(views)) if relief is None else relief.at(place)
    start = Cameras(
        np.column_stack([place, height + level]),
        np.array(list(map(tilted_axes, yaw, tilt))),
        focal,
        groups,
        relief,
    )
    return tags, start, cameras


def _measured(tags: Sequence[Measured | None]) -> Floats:
    return np.array([(math.nan, 1.0) if tag is None else tag for tag in tags]).T


def _as_tagged(tags: Tags, solved: Cameras) -> Cameras | None:
    """Return the cameras as tagged; None if a heading or a height is missing."""
    if not (np.isfinite(tags.yaw_rad).all() and np.isfinite(tags.height_m).all()):
        return None
    axes = np.array(list(map(tilted_axes, tags.yaw_rad, tags.tilt)))
    centre = np.column_stack([tags.place_m, tags.height_m])
    return Cameras(centre, axes, tags.focal_px, solved.groups, solved.relief)
