"""How certain adjusted poses are: the diagonal of the inverse of the normal equations."""

from __future__ import annotations

from typing import Final

import numpy as np

from vision.registration.ground_plane import UNKNOWNS
from vision.registration.normal_equations import Normal
from vision.registration.views import Floats

MOST_EXACT: Final = 200
"""Nets of more views than this are inverted piece by piece."""

_PIECE = 60  # views

_HOPS = 2  # a view's piece: those that overlap it, and those that overlap them


def sigmas(normal: Normal) -> Floats:
    """Standard deviations (views, 6) of the unknowns, tags included.

    Of a net with more than `MOST_EXACT` views each is reckoned as if the poses farther off than
    `_HOPS` overlaps were known: that is how certain it is beside the views around it.
    """
    views = len(normal.diagonal)
    links: list[list[int]] = [[] for _ in range(views)]  # the blocks of each view
    for at, (i, j) in enumerate(normal.pairs.tolist()):
        links[i].append(at)
        links[j].append(at)
    if views <= MOST_EXACT:
        return _inverse_diagonal(normal, list(range(views)), links)
    ends = normal.pairs.sum(axis=1)
    found = np.zeros((views, UNKNOWNS))
    for k in range(views):
        piece, last = {k: None}, [k]
        for _ in range(_HOPS):
            around = (int(ends[at]) - v for v in last for at in links[v])
            last = [n for n in dict.fromkeys(around) if n not in piece]
            piece |= dict.fromkeys(last)
        found[k] = _inverse_diagonal(normal, list(piece)[:_PIECE], links)[0]
    return found


def _inverse_diagonal(normal: Normal, chosen: list[int], links: list[list[int]]) -> Floats:
    """Of the chosen views, in their order; all others are held."""
    n = len(chosen)
    place = {v: at for at, v in enumerate(chosen)}
    own, shared = UNKNOWNS * n, normal.corner.shape[0]
    matrix = np.zeros((own + shared, own + shared))
    for at, v in enumerate(chosen):
        rows = slice(UNKNOWNS * at, UNKNOWNS * (at + 1))
        matrix[rows, rows] = normal.diagonal[v]
        matrix[rows, own:] = normal.border[v]
        matrix[own:, rows] = normal.border[v].T
    matrix[own:, own:] = normal.corner
    for at in sorted({at for v in chosen for at in links[v]}):
        i, j = (int(v) for v in normal.pairs[at])
        if i in place and j in place:
            a, b = UNKNOWNS * place[i], UNKNOWNS * place[j]
            matrix[a : a + UNKNOWNS, b : b + UNKNOWNS] += normal.across[at]
            matrix[b : b + UNKNOWNS, a : a + UNKNOWNS] += normal.across[at].T
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.inv(matrix * scale[:, None] * scale)
    variance = np.diag(inverse)[:own] * scale[:own] ** 2
    deviations: Floats = np.sqrt(np.maximum(variance, 0.0)).reshape(n, UNKNOWNS)
    return deviations
