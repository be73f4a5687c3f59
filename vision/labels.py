"""The orientation of pictures from the agreement of pairs: labels of a graph."""

from __future__ import annotations

import heapq
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Scores = Mapping[tuple[int, int], NDArray[np.float64]]
"""The agreement of pictures i < j for (i turned, j turned): 2 x 2, 0 to 1."""

_Neighbours = Mapping[int, Mapping[int, NDArray[np.float64]]]

MARGIN = 0.05
"""Mean gain per pair below which nothing is turned."""


def best_labels(count: int, scores: Scores) -> tuple[bool, ...]:
    """Return for each picture whether it is turned, so that the sum over the pairs is largest.

    The search visits every pair a few times. Pictures that pairs connect are labelled together;
    they stay as stored if turning gains less than `MARGIN` per pair.

    >>> best_labels(3, {(0, 1): np.array([[0.1, 0.9], [0.8, 0.1]])})
    (False, True, False)
    """
    near: dict[int, dict[int, NDArray[np.float64]]] = {k: {} for k in range(count)}
    for (i, j), table in scores.items():
        near[i][j], near[j][i] = table, table.T
    turned = [False] * count
    seen: set[int] = set()
    for first in range(count):
        if first in seen or not near[first]:
            continue
        component = _component(first, near)
        seen.update(component)
        grown = [_grown(first, way, near) for way in (False, True)]
        labels = max(grown, key=lambda found: _sum(found, near))
        as_stored = dict.fromkeys(component, False)
        pairs = sum(len(near[k]) for k in component) // 2
        if _sum(labels, near) > _sum(as_stored, near) + MARGIN * pairs:
            for k, way in labels.items():
                turned[k] = way
    return tuple(turned)


def _component(first: int, near: _Neighbours) -> set[int]:
    found, edge = {first}, [first]
    while edge:
        for k in near[edge.pop()]:
            if k not in found:
                found.add(k)
                edge.append(k)
    return found


def _gain(k: int, labels: Mapping[int, bool], near: _Neighbours) -> float:
    """Return the gain of turning picture k, given the labels of its neighbours."""
    total = 0.0
    for other, table in near[k].items():
        if other in labels:
            column = int(labels[other])
            total += float(table[1, column] - table[0, column])
    return total


def _grown(first: int, way: bool, near: _Neighbours) -> dict[int, bool]:
    """Label outwards from a picture, the clearest next; then mend."""
    labels: dict[int, bool] = {}
    heap: list[tuple[float, int]] = [(0.0, first)]
    clearest = {first: 0.0}
    while heap:
        sureness, k = heapq.heappop(heap)
        if k in labels or -sureness != clearest[k]:
            continue
        labels[k] = _gain(k, labels, near) > 0.0 if labels else way
        for other in near[k]:
            if other not in labels:
                clearest[other] = abs(_gain(other, labels, near))
                heapq.heappush(heap, (-clearest[other], other))
    _mend(labels, near)
    return labels


def _mend(labels: dict[int, bool], near: _Neighbours) -> None:
    """Turn the picture that disagrees most with its neighbours until none does."""
    gains = {k: _gain(k, labels, near) for k in labels}
    for _ in range(len(labels)):
        wrong = [k for k, gain in gains.items() if (gain > 0.0) != labels[k]]
        if not wrong:
            return
        worst = max(wrong, key=lambda k: (abs(gains[k]), -k))
        labels[worst] = not labels[worst]
        for other in near[worst]:
            gains[other] = _gain(other, labels, near)


def _sum(labels: Mapping[int, bool], near: _Neighbours) -> float:
    return sum(
        float(table[int(labels[i]), int(labels[j])])
        for i in sorted(labels)
        for j, table in near[i].items()
        if i < j
    )
