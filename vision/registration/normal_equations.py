"""Sparse normal equations: blocks of 6 unknowns for each view, and a few unknowns shared by all.

Conjugate gradients solve them. Memory and the cost of a step are linear in the overlaps. All sums
have one order, so the number of threads does not change the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vision.registration.ground_plane import UNKNOWNS
from vision.registration.views import Floats, Ints

TOLERANCE: Final = 1e-6
MAX_ROUNDS: Final = 400


@dataclass
class Normal:
    """The symmetric system `A x = b` in blocks.

    Attributes:
        diagonal: (views, 6, 6).
        pairs: (pairs, 2) indices of views.
        across: (pairs, 6, 6), the block of row `pairs[:, 0]` and column `pairs[:, 1]`.
        border: (views, 6, shared), the coupling to the shared unknowns.
        corner: (shared, shared).
        right: (views, 6), the right-hand side.
        right_shared: (shared,).
    """

    diagonal: Floats
    pairs: Ints
    across: Floats
    border: Floats
    corner: Floats
    right: Floats
    right_shared: Floats

    @classmethod
    def zeros(cls, views: int, pairs: Ints, shared: int) -> Normal:
        """Return a system without any observation."""
        n = UNKNOWNS
        return cls(
            np.zeros((views, n, n)),
            pairs,
            np.zeros((len(pairs), n, n)),
            np.zeros((views, n, shared)),
            np.zeros((shared, shared)),
            np.zeros((views, n)),
            np.zeros(shared),
        )

    def damped(self, factor: float) -> Normal:
        """Raise the diagonal by `factor` of itself (Levenberg-Marquardt)."""
        diagonal, corner = self.diagonal.copy(), self.corner.copy()
        i, s = np.arange(UNKNOWNS), np.arange(len(corner))
        diagonal[:, i, i] *= 1.0 + factor
        corner[s, s] *= 1.0 + factor
        return replace(self, diagonal=diagonal, corner=corner)

    def solve(self) -> tuple[Floats, Floats]:
        """Return the unknowns of the views (views, 6), and the shared ones."""
        scale, scaled = self._scaled()
        x, y = scaled._conjugate_gradients()
        return x * scale[0], y * scale[1]

    def _scaled(self) -> tuple[tuple[Floats, Floats], Normal]:
        own = 1.0 / np.sqrt(np.maximum(np.einsum("nii->ni", self.diagonal), 1e-300))
        shared = 1.0 / np.sqrt(np.maximum(np.einsum("ii->i", self.corner), 1e-300))
        i, j = self.pairs[:, 0], self.pairs[:, 1]
        return (own, shared), Normal(
            self.diagonal * own[:, :, None] * own[:, None, :],
            self.pairs,
            self.across * own[i][:, :, None] * own[j][:, None, :],
            self.border * own[:, :, None] * shared,
            self.corner * shared[:, None] * shared,
            self.right * own,
            self.right_shared * shared,
        )

    def _conjugate_gradients(self) -> tuple[Floats, Floats]:
        blocks = np.linalg.inv(self.diagonal)
        corner = np.linalg.inv(self.corner) if len(self.corner) else self.corner
        neighbours = _Neighbours.from_pairs(self.pairs, self.across, len(self.diagonal))

        def product(x: Floats, y: Floats) -> tuple[Floats, Floats]:
            views = np.einsum("nij,nj->ni", self.diagonal, x) + neighbours.times(x)
            views += np.einsum("nis,s->ni", self.border, y)
            shared = np.einsum("nis,ni->s", self.border, x) + np.einsum("st,t->s", self.corner, y)
            return views, shared

        def preconditioned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
            return np.einsum("nij,nj->ni", blocks, x), np.einsum("st,t->s", corner, y)

        def dot(a: tuple[Floats, Floats], b: tuple[Floats, Floats]) -> float:
            return float(np.einsum("ni,ni->", a[0], b[0]) + np.einsum("s,s->", a[1], b[1]))

        x = (np.zeros_like(self.right), np.zeros_like(self.right_shared))
        rest = (self.right.copy(), self.right_shared.copy())
        way = z = preconditioned(*rest)
        size = first = dot(rest, z)
        for _ in range(MAX_ROUNDS):
            if size <= TOLERANCE**2 * first:
                break
            image = product(*way)
            step = size / dot(way, image)
            x = (x[0] + step * way[0], x[1] + step * way[1])
            rest = (rest[0] - step * image[0], rest[1] - step * image[1])
            z = preconditioned(*rest)
            size, last = dot(rest, z), size
            way = (z[0] + size / last * way[0], z[1] + size / last * way[1])
        return x


@dataclass
class _Neighbours:
    """The blocks off the diagonal, in both directions, by the row that they add to."""

    starts: Ints
    rows: Ints
    columns: Ints
    blocks: Floats
    views: int

    @classmethod
    def from_pairs(cls, pairs: Ints, across: Floats, views: int) -> _Neighbours:
        rows = np.concatenate([pairs[:, 0], pairs[:, 1]])
        columns = np.concatenate([pairs[:, 1], pairs[:, 0]])
        blocks = np.concatenate([across, across.transpose(0, 2, 1)])
        order = np.lexsort((columns, rows))
        rows, columns, blocks = rows[order], columns[order], blocks[order]
        starts = np.flatnonzero(np.r_[True, rows[1:] != rows[:-1]]) if len(rows) else rows
        return cls(starts, rows[starts], columns, np.ascontiguousarray(blocks), views)

    def times(self, x: Floats) -> Floats:
        result = np.zeros((self.views, UNKNOWNS))
        if len(self.starts):
            parts = np.einsum("nij,nj->ni", self.blocks, x[self.columns])
            result[self.rows] = np.add.reduceat(parts, self.starts, axis=0)
        return result


MAX_EXACT_VIEWS: Final = 200
"""Maximum number of views of a net that is inverted as a whole."""

_PIECE = 60  # views

_HOPS = 2  # a view's piece: views that overlap it, and views that overlap those


def sigmas(normal: Normal) -> Floats:
    """Return standard deviations (views, 6) of the unknowns, tags included.

    In a net of more than `MAX_EXACT_VIEWS` views each is computed as if poses farther than `_HOPS`
    overlaps were known. It is then the certainty relative to the views around it.
    """
    views = len(normal.diagonal)
    links: list[list[int]] = [[] for _ in range(views)]  # the blocks of each view
    for at, (i, j) in enumerate(normal.pairs.tolist()):
        links[i].append(at)
        links[j].append(at)
    if views <= MAX_EXACT_VIEWS:
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
    """Return those of the chosen views, in their order; all other poses are fixed."""
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
