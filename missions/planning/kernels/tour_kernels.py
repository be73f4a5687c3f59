"""Tours of a team past places: observation points, their order, and the vehicle that visits them.

For a large region with a known outline, the annealing of `missions.planning.kernels.swath` needs a
good beginning, as each of its steps weighs every frame. Here a tour is only an order of places, and
the time of a leg a formula. So thousands of orders are tried in milliseconds. Metres, seconds;
places in the frame of the region.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import copy_piece, draw, kernel, part, team_s, uniform

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]

_NOWHERE = 1e18
_LEG_SHARE = 0.45  # of a leg, for an arc at either end
_BACK = -0.97  # the cosine of a turn beyond which a vehicle halts
_LONGEST = 30  # maximum number of places that are moved at once
_NEAR = 8  # number of places that may follow one another


class Crew(NamedTuple):
    """The vehicles; a row each."""

    start: Floats
    """(vehicles, 2): starting places."""
    heading: Floats
    """(vehicles, 2): unit vector of the direction of flight at the start; zeros at rest."""
    end: Floats
    """(vehicles, 2): ends of tours."""
    begin_s: Floats
    """(vehicles,): delays of the starts, s."""
    blind_s: Floats
    """(vehicles,): times until which frames do not count, s; a vehicle flies to its first place."""
    speed: Floats
    accel: float
    cut_m: float
    """Cut of corners, m."""


@part
def _richest(row: Ints) -> int:
    """Return the first place of the largest number."""
    best = 0
    for j in range(1, row.shape[0]):
        if row[j] > row[best]:
            best = j
    return best


@kernel
def look_from(
    work: Flags, columns: int, rows: int, wide: int, high: int, most: int
) -> tuple[Floats, Ints]:
    """Return at most `most` places from which all work is seen, greedily: (places, place of each
    cell).

    `work` has a 1 for each cell of a window of `columns` by `rows`; from a place `wide` by `high`
    cells are seen. A place is the middle of such a rectangle, in cells from the middle of the first
    cell of the window. A cell without work, or beyond the last place, has the place -1.
    """
    left = work.copy()
    places, of = np.empty((most, 2)), np.empty(columns * rows, np.int64)
    tall, broad = rows - high + 1, columns - wide + 1
    seen = np.zeros((tall, broad), np.int64)
    for r in range(rows):
        for c in range(columns):
            of[r * columns + c] = -1
            if left[r * columns + c]:
                for i in range(max(0, r - high + 1), min(tall, r + 1)):
                    for j in range(max(0, c - wide + 1), min(broad, c + 1)):
                        seen[i, j] += 1
    best = np.zeros(tall, np.int64)  # the best of each row of rectangles
    for i in range(tall):
        best[i] = _richest(seen[i])
    count = 0
    while count < most:
        at = 0
        for i in range(1, tall):
            if seen[i, best[i]] > seen[at, best[at]]:
                at = i
        j0 = int(best[at])
        if seen[at, j0] == 0:
            break
        for r in range(at, at + high):
            for c in range(j0, j0 + wide):
                k = r * columns + c
                if left[k]:
                    left[k] = 0
                    of[k] = count
                    for i in range(max(0, r - high + 1), min(tall, r + 1)):
                        for j in range(max(0, c - wide + 1), min(broad, c + 1)):
                            seen[i, j] -= 1
        for i in range(max(0, at - high + 1), min(tall, at + high)):
            best[i] = _richest(seen[i])
        places[count, 0] = j0 + 0.5 * (wide - 1)
        places[count, 1] = at + 0.5 * (high - 1)
        count += 1
    return places[:count].copy(), of


@part
def _corner_v(
    speed: float,
    accel: float,
    cut: float,
    in_x: float,
    in_y: float,
    in_m: float,
    out_x: float,
    out_y: float,
    out_m: float,
) -> float:
    """Return the speed of a corner between two legs, given by vectors and their lengths."""
    if in_m < 1e-6 or out_m < 1e-6:
        return speed
    cos = (in_x * out_x + in_y * out_y) / (in_m * out_m)
    if cos > 0.9998:
        return speed
    if cos < _BACK:
        return 0.0
    half_cos = math.sqrt(0.5 * (1.0 + cos))
    half_tan = math.sqrt(max(0.0, 1.0 - half_cos * half_cos)) / half_cos
    radius = cut * half_cos / (1.0 - half_cos)
    radius = min(radius, _LEG_SHARE * min(in_m, out_m) / half_tan)
    return min(speed, math.sqrt(accel * radius))


@part
def _leg_s(length: float, first: float, last: float, speed: float, accel: float) -> float:
    """Return the time of a leg between two speeds, as if either could be reached."""
    if length < 1e-6:
        return 0.0
    peak = math.sqrt(0.5 * (first * first + last * last) + accel * length)
    if peak < max(first, last):  # too short for such a change of speed
        return 2.0 * length / (first + last)
    peak = min(speed, peak)
    up = peak - first
    down = peak - last
    flat = length - (up * (peak + first) + down * (peak + last)) / (2.0 * accel)
    return (up + down) / accel + max(0.0, flat) / peak


@part
def tour_s(crew: Crew, v: int, places: Floats, order: Ints, m: int) -> float:
    """Return the time of a vehicle past `m` places and to its end, including its delay, s."""
    speed, accel, cut = crew.speed[v], crew.accel, crew.cut_m
    x, y = crew.start[v, 0], crew.start[v, 1]
    in_x, in_y = crew.heading[v, 0], crew.heading[v, 1]
    in_m = 1000.0 * math.sqrt(in_x * in_x + in_y * in_y)
    in_x, in_y = 1000.0 * in_x, 1000.0 * in_y
    stands = in_m < 1e-6
    total = crew.begin_s[v]
    before = 0.0  # speed at the beginning of the present leg
    length = 0.0
    for k in range(m + 1):
        if k < m:
            px, py = places[order[k], 0], places[order[k], 1]
        else:
            px, py = crew.end[v, 0], crew.end[v, 1]
        out_x, out_y = px - x, py - y
        out_m = math.sqrt(out_x * out_x + out_y * out_y)
        at = 0.0
        if not (k == 0 and stands):
            at = _corner_v(speed, accel, cut, in_x, in_y, in_m, out_x, out_y, out_m)
        if k > 0:
            total += _leg_s(length, before, at, speed, accel)
            if k == 1:
                total = max(total, crew.blind_s[v])
        elif not stands:  # it has to slow down to turn
            total += (speed - at) / accel
        before, length = at, out_m
        if out_m > 1e-6:
            x, y, in_x, in_y, in_m = px, py, out_x, out_y, out_m
    total += _leg_s(length, before, 0.0, speed, accel)
    return float(total)


@kernel
def begin_with(crew: Crew, places: Floats, n: int, order: Ints, counts: Ints) -> None:
    """Lay a first tour: the vehicle that is done first continues to its nearest place."""
    vehicles = counts.shape[0]
    at = crew.start.copy()
    busy = crew.begin_s.copy()
    free = np.ones(n, np.uint8)
    for v in range(vehicles):
        counts[v] = 0
    for _ in range(n):
        v, soonest, least = 0, _NOWHERE, -1
        for w in range(vehicles):
            k_best, m_best = -1, _NOWHERE
            for k in range(n):
                if free[k]:
                    dx, dy = places[k, 0] - at[w, 0], places[k, 1] - at[w, 1]
                    away = dx * dx + dy * dy
                    if away < m_best:
                        k_best, m_best = k, away
            done = busy[w] + math.sqrt(m_best) / crew.speed[w]
            hx, hy = places[k_best, 0] - crew.end[w, 0], places[k_best, 1] - crew.end[w, 1]
            done += math.sqrt(hx * hx + hy * hy) / crew.speed[w]
            if done < soonest:
                v, soonest, least = w, done, k_best
        dx, dy = places[least, 0] - at[v, 0], places[least, 1] - at[v, 1]
        busy[v] += math.sqrt(dx * dx + dy * dy) / crew.speed[v]
        at[v, 0], at[v, 1] = places[least, 0], places[least, 1]
        order[v, counts[v]] = least
        counts[v] += 1
        free[least] = 0


@part
def neighbours(places: Floats, n: int, near: Ints) -> None:
    """Write into each row of `near` the numbers of the nearest places."""
    many = near.shape[1]
    away = np.empty(many)
    for a in range(n):
        found = 0
        for b in range(n):
            if b == a:
                continue
            dx, dy = places[a, 0] - places[b, 0], places[a, 1] - places[b, 1]
            far = dx * dx + dy * dy
            if found == many and far >= away[many - 1]:
                continue
            k = found if found < many else many - 1
            while k > 0 and away[k - 1] > far:
                away[k] = away[k - 1]
                near[a, k] = near[a, k - 1]
                k -= 1
            away[k] = far
            near[a, k] = b
            found = min(found + 1, many)


@part
def _move(
    order: Ints, counts: Ints, v: int, i: int, length: int, u: int, j: int, back: bool,
    first: Ints, second: Ints, new: Ints,
) -> None:  # fmt: skip
    """Move `length` places of `v` from its `i`-th on before the `j`-th of `u`, reversed or not.

    If `u` is `v`, `j` counts without them, and all goes into `first`.
    """
    m = counts[v]
    rest = m - length
    if u == v:
        at = 0
        for k in range(rest + 1):
            if k == j:
                for b in range(length):
                    first[at] = order[v, i + (length - 1 - b if back else b)]
                    at += 1
            if k < rest:
                first[at] = order[v, k if k < i else k + length]
                at += 1
        new[0] = m
        return
    copy_piece(order[v], 0, i, first, 0)
    copy_piece(order[v], i + length, m, first, i)
    copy_piece(order[u], 0, j, second, 0)
    for b in range(length):
        second[j + b] = order[v, i + (length - 1 - b if back else b)]
    copy_piece(order[u], j, counts[u], second, j + length)
    new[0], new[1] = rest, counts[u] + length


@part
def _change(
    order: Ints, counts: Ints, v: int, i: int, u: int, j: int, random: Ints,
    first: Ints, second: Ints, new: Ints,
) -> bool:  # fmt: skip
    """Have the `i`-th place of `v` and the `j`-th of `u` follow one another, in some way."""
    m = counts[v]
    kind = uniform(random)
    if u == v and kind < 0.4:  # the part between is reversed
        low, high = (i + 1, j) if i < j else (j, i - 1)
        if low >= high:
            return False
        copy_piece(order[v], 0, m, first, 0)
        for k in range(high - low + 1):
            first[low + k] = order[v, high - k]
        new[0] = m
        return True
    if u != v and kind < 0.3:  # each continues with the rest of the other
        m2 = counts[u]
        copy_piece(order[v], 0, i + 1, first, 0)
        copy_piece(order[u], j, m2, first, i + 1)
        copy_piece(order[u], 0, j, second, 0)
        copy_piece(order[v], i + 1, m, second, j)
        new[0], new[1] = i + 1 + m2 - j, j + m - i - 1
        return True
    length = min(m - i, 1 + int(_LONGEST * uniform(random) ** 4))
    if u == v:
        if i <= j < i + length:
            return False
        j = j if j < i else j - length
    to = j + (1 if uniform(random) < 0.5 else 0)
    _move(order, counts, v, i, length, u, to, uniform(random) < 0.5, first, second, new)
    return True


@part
def _propose(
    order: Ints, counts: Ints, near: Ints, who: Ints, which: Ints, random: Ints,
    first: Ints, second: Ints, new: Ints,
) -> tuple[int, int]:  # fmt: skip
    """Draw other tours for two vehicles, or twice the same one; (-1, -1) if there are none."""
    a = draw(random, near.shape[0])
    v, i = who[a], which[a]
    kind = uniform(random)
    if near.shape[1] > 0 and kind < 0.95:
        b = near[a, draw(random, near.shape[1])]
        u = who[b]
        if not _change(order, counts, v, i, u, which[b], random, first, second, new):
            return -1, -1
        return v, u
    u = draw(random, counts.shape[0])  # anywhere, also to a vehicle without places
    if u == v:
        return -1, -1
    length = min(counts[v] - i, 1 + int(_LONGEST * uniform(random) ** 2))
    j = draw(random, counts[u] + 1)
    _move(order, counts, v, i, length, u, j, kind < 0.975, first, second, new)
    return v, u


@kernel
def anneal(
    crew: Crew,
    places: Floats,
    order: Ints,
    counts: Ints,
    moves: int,
    hot: float,
    cold: float,
    last: float,
    random: Ints,
) -> float:
    """Search faster tours, in place; return the seconds of the team.

    `order` has a row for each vehicle, a column more than there are places; `counts` is the number
    of valid places in a row. Each place is in one tour.
    """
    vehicles = counts.shape[0]
    total = np.empty(vehicles)
    for v in range(vehicles):
        total[v] = tour_s(crew, v, places, order[v], counts[v])
    cost = team_s(total, last)
    best, best_counts, best_cost = np.empty(order.shape, np.int64), np.empty_like(counts), cost
    _copy(order, counts, best, best_counts)
    first, second = np.empty(order.shape[1], np.int64), np.empty(order.shape[1], np.int64)
    new = np.zeros(2, np.int64)
    after = np.empty(vehicles)
    n = order.shape[1] - 1
    near = np.empty((n, min(_NEAR, n - 1)), np.int64)
    neighbours(places, n, near)
    who, which = np.empty(n, np.int64), np.empty(n, np.int64)
    for v in range(vehicles):
        _keep(order, counts, v, order[v], counts[v], who, which)
    temperature, cooling = hot, (cold / hot) ** (1.0 / max(1, moves))
    for _ in range(moves):
        temperature *= cooling
        v, u = _propose(order, counts, near, who, which, random, first, second, new)
        if v < 0:
            continue
        copy_piece(total, 0, vehicles, after, 0)
        after[v] = tour_s(crew, v, places, first, new[0])
        if u != v:
            after[u] = tour_s(crew, u, places, second, new[1])
        rise = team_s(after, last) - cost
        if rise >= 0.0 and uniform(random) >= math.exp(-rise / temperature):
            continue
        cost += rise
        copy_piece(after, 0, vehicles, total, 0)
        _keep(order, counts, v, first, new[0], who, which)
        if u != v:
            _keep(order, counts, u, second, new[1], who, which)
        if cost < best_cost - 1e-9:
            best_cost = cost
            _copy(order, counts, best, best_counts)
    _copy(best, best_counts, order, counts)
    return best_cost


@part
def _keep(order: Ints, counts: Ints, v: int, tour: Ints, m: int, who: Ints, which: Ints) -> None:
    """Make the first `m` places of `tour` those of a vehicle."""
    counts[v] = m
    for k in range(m):
        order[v, k] = tour[k]
        who[tour[k]], which[tour[k]] = v, k


@part
def _copy(order: Ints, counts: Ints, to: Ints, to_counts: Ints) -> None:
    for v in range(counts.shape[0]):
        copy_piece(order[v], 0, counts[v], to[v], 0)
        to_counts[v] = counts[v]
