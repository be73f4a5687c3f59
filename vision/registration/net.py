"""The net of overlapping views: its components, and a first pose for each view.

A level camera shows flat ground by a similarity. Pixels are complex numbers (right - i down,
levelled by the tagged tilt), ground points are east + i north, and `ground = c pixel + t`. A pixel
has `abs(c)` metres, `-arg(c)` is the bearing of the upper edge, `t` the place below the camera.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vision.registration.ground_plane import tilted_axes
from vision.registration.matching import Pair
from vision.registration.views import Floats, View

Complex: TypeAlias = NDArray[np.complex128]

HEIGHT_BIAS: Final = 0.1
"""Standard deviation of the common error of a net's height tags, as a share of the height.
The ground is not at the level of take-off, and the focal length differs from its tag.
"""

YAW_BIAS_RAD: Final = math.radians(5.0)
"""Standard deviation of the common error of headings: the compass, the camera's mounting."""

MAX_YAW_SIGMA_RAD: Final = math.radians(15.0)
"""Maximum uncertainty of the heading of a net that is placed on the ground, rad."""

MAX_SCALE_SIGMA: Final = 0.25
"""Maximum uncertainty of the scale of such a net, as a share."""

_HALF_TURN_CLEAR_RAD = math.radians(40.0)  # this certainty of geotags excludes the reverse heading


def components(count: int, links: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return the groups of `count` views that links connect, each sorted, the largest first."""
    group = list(range(count))

    def root(k: int) -> int:
        while group[k] != k:
            group[k] = group[group[k]]
            k = group[k]
        return k

    for one, other in links:
        a, b = root(one), root(other)
        group[max(a, b)] = min(a, b)
    found: dict[int, list[int]] = {}
    for k in range(count):
        found.setdefault(root(k), []).append(k)
    return sorted(found.values(), key=lambda members: (-len(members), members))


def chained(views: Sequence[View], pairs: Sequence[Pair]) -> tuple[Complex, Complex]:
    """Return first poses `c`, `t` of connected views: from pair to pair, the most certain first.

    The first view has `c = 1`, `t = 0`.
    """
    scale, place = np.zeros(len(views), complex), np.zeros(len(views), complex)
    scale[0] = 1.0
    steps: dict[tuple[int, int], tuple[complex, complex]] = {}
    links: list[list[Pair]] = [[] for _ in views]
    for pair in pairs:
        links[pair.first].append(pair)
        links[pair.second].append(pair)
        z = levelled(views[pair.first], pair.in_first)
        w = levelled(views[pair.second], pair.in_second)
        steps[pair.first, pair.second] = _similarity(w, z)
        steps[pair.second, pair.first] = _similarity(z, w)
    reached = {0}
    open_links = [(-p.inliers, p.first, p.second) for p in links[0]]
    heapq.heapify(open_links)
    while open_links:
        _, a, b = heapq.heappop(open_links)
        if a in reached and b in reached:
            continue
        known, new = (a, b) if a in reached else (b, a)
        step, offset = steps[known, new]
        scale[new] = scale[known] * step
        place[new] = scale[known] * offset + place[known]
        reached.add(new)
        for p in links[new]:
            heapq.heappush(open_links, (-p.inliers, p.first, p.second))
    return scale, place


def levelled(view: View, pixels: Floats) -> Complex:
    """Return the pixels of a level camera, its upper edge to the north: east + i north."""
    axes = tilted_axes(0.0, view.tilt)
    rays = np.concatenate([pixels / view.focal_px.value, np.ones((len(pixels), 1))], axis=1)
    east, north, up = np.einsum("ij,nj->in", axes, rays)
    points: Complex = view.focal_px.value * (east + 1j * north) / np.maximum(-up, 0.1)
    return points


def _similarity(source: Complex, target: Complex) -> tuple[complex, complex]:
    """Fit `target = a source + b` by least squares."""
    s, t = source - source.mean(), target - target.mean()
    a = complex((np.conj(s) * t).sum() / max(float((np.abs(s) ** 2).sum()), 1e-12))
    return a, complex(target.mean() - a * source.mean())


@dataclass(frozen=True, slots=True)
class PlacedNet:
    """A net on the ground.

    Attributes:
        scale: `c` of each view.
        place: `t` of each view, metres.
        turned: True for each view whose tagged heading is that of the lower edge.
        yaw_sigma_rad: Uncertainty of the heading of the whole net.
        scale_sigma: Uncertainty of its scale, as a share.
        position_sigma_m: Error of single geotags, as found; None for too few of them.
    """

    scale: Complex
    place: Complex
    turned: NDArray[np.bool_]
    yaw_sigma_rad: float
    scale_sigma: float
    position_sigma_m: float | None


def place_net(views: Sequence[View], scale: Complex, place: Complex) -> PlacedNet:
    """Turn, scale and shift a chained net to fit its tags, robustly."""
    tags = np.array([complex(v.east_m, v.north_m) for v in views])
    sigmas_m = np.array([v.position_sigma_m for v in views])
    factor, left = _aligned(tags, place, sigmas_m)
    spread = abs(factor) * math.sqrt(float((np.abs(place - place.mean()) ** 2 / sigmas_m**2).sum()))
    sigma = 1.0 / max(spread, 1e-9)
    size, size_sigma = _log_scale(views, scale, math.log(max(abs(factor), 1e-12)), sigma)
    angle, angle_sigma, turned = _angle(views, scale, float(np.angle(factor)), sigma)
    whole = math.exp(size) * complex(math.cos(angle), math.sin(angle))
    weights = left / sigmas_m**2
    middle = (weights * (tags - whole * place)).sum() / weights.sum()
    laid_place = whole * place + middle
    return PlacedNet(
        whole * scale, laid_place, turned, angle_sigma, size_sigma, _spread(tags - laid_place)
    )


def _aligned(tags: Complex, place: Complex, sigmas_m: Floats) -> tuple[complex, Floats]:
    """Fit `tags = factor place + offset` robustly; return the factor and the weights, 0 to 1."""
    weights = np.ones(len(tags))
    factor = 0j
    for _ in range(20):
        w = weights / sigmas_m**2
        mean_p, mean_t = (w * place).sum() / w.sum(), (w * tags).sum() / w.sum()
        p, t = place - mean_p, tags - mean_t
        factor = complex((w * np.conj(p) * t).sum() / max((w * np.abs(p) ** 2).sum(), 1e-12))
        offset = complex(mean_t - factor * mean_p)
        off = np.abs(tags - factor * place - offset) / sigmas_m
        limit = max(1.5 * float(np.median(off)), 0.1)
        weights = np.minimum(1.0, limit / np.maximum(off, 1e-9))
    return factor, weights


def _spread(left: Complex) -> float | None:
    """Return the deviation in one direction of geotags' residuals; None for fewer than 6."""
    if len(left) < 6:
        return None
    median = float(np.median(np.abs(left))) / 1.177  # of a Rayleigh distribution
    return median * math.sqrt(len(left) / (len(left) - 2.0))


def _log_scale(
    views: Sequence[View], scale: Complex, by_tags: float, sigma: float
) -> tuple[float, float]:
    """Return the log of the net's scale, by geotags and tagged heights, and its uncertainty."""
    tagged = [
        math.log((v.height_m.value - v.ground_m) / v.focal_px.value / abs(c))
        for v, c in zip(views, scale, strict=True)
        if v.height_m is not None and abs(c) > 0.0 and v.height_m.value > v.ground_m
    ]
    if not tagged:
        return by_tags, sigma
    spread = float(np.median([v.height_m.sigma / v.height_m.value for v in views if v.height_m]))
    tag_sigma = math.hypot(HEIGHT_BIAS, spread / math.sqrt(len(tagged)))
    share = (1.0 / sigma**2) / (1.0 / sigma**2 + 1.0 / tag_sigma**2)
    return (
        share * by_tags + (1.0 - share) * float(np.median(tagged)),
        1.0 / math.hypot(1.0 / sigma, 1.0 / tag_sigma),
    )


def _angle(
    views: Sequence[View], scale: Complex, by_tags: float, sigma: float
) -> tuple[float, float, NDArray[np.bool_]]:
    """Return the anticlockwise turn of the net, its uncertainty, and the views upside down."""
    turned = np.zeros(len(views), bool)
    known = [k for k, v in enumerate(views) if v.yaw_rad is not None]
    if not known:
        return by_tags, sigma, turned
    priors = [p for v in views if (p := v.yaw_rad) is not None]
    # anticlockwise turn that would give each view its tagged heading
    wanted = np.array(
        [-p.value - float(np.angle(scale[k])) for p, k in zip(priors, known, strict=True)]
    )
    axis = float(np.angle(np.exp(2j * wanted).sum())) / 2.0
    for _ in range(5):  # a few wrong ones do not shift the median
        axis += float(np.median(np.angle(np.exp(2j * (wanted - axis))))) / 2.0
    if sigma < _HALF_TURN_CLEAR_RAD:
        reverse = math.cos(by_tags - axis) < 0.0
    else:
        reverse = float(np.cos(wanted - axis).sum()) < 0.0
    if reverse:
        axis += math.pi
    turned[known] = np.cos(wanted - axis) < 0.0
    each = float(np.median([p.sigma for p in priors]))
    tag_sigma = math.hypot(YAW_BIAS_RAD, each / math.sqrt(len(known)))
    share = (1.0 / sigma**2) / (1.0 / sigma**2 + 1.0 / tag_sigma**2)
    off = math.remainder(by_tags - axis, math.tau)
    if abs(off) > 3.0 * math.hypot(sigma, tag_sigma):
        share = 1.0 if sigma < tag_sigma else 0.0  # one of the two is plainly wrong
    return axis + share * off, 1.0 / math.hypot(1.0 / sigma, 1.0 / tag_sigma), turned
