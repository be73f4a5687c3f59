"""Routes of a team through sites: cheapest insertion and local search over a matrix of leg costs.

Sites are numbered: 0 .. K-1 the nodes to visit, K .. K+R-1 the robots, K+R home. A route leads from
its robot through its nodes and home; its length is the sum of its legs and of its nodes' loads.
Minimised is the sum of (length + 1)^6 over the robots: nearly the longest, but with some weight of
the others. Added is a part of the same for the tours that would end up longer, as more is found
behind a node. So uncertain nodes come early on a route. `routes` has a row of nodes for each robot,
`counts` the number of valid nodes in a row, `costs` the cost of each route.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import copy_piece, kernel, part

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
"""Indices and counts, which add up with others; a part for both kinds would be compiled twice."""

NEAR, ONE_FAR = 8, 8
"""Number of nodes and robots near a node; one attempt in `ONE_FAR` takes any other instead."""


class Outlays(NamedTuple):
    """The costs of routes through K nodes."""

    legs: Floats
    """Leg costs from site to site, (K+R+1, K+R+1), symmetric."""
    loads: Floats
    """Additional cost of a node, (K,)."""
    behind: Floats
    """Possible extension of a tour by finds behind a node, (K,); 0 without any."""
    share: float
    """Weight of such a longer tour beside the known tour."""


@part
def draw(state: int) -> int:
    """Return the next state of a small congruential generator; its upper bits, `state >> 8`, are
    drawn."""
    return (state * 1103515245 + 12345) & 0x7FFFFFFF


@part
def sixth(length: float) -> float:
    """Return the cost of a tour of a length: (length + 1)^6."""
    square = (length + 1.0) * (length + 1.0)
    return square * square * square


@part
def price(
    outlays: Outlays,
    route: Ints,
    count: int,
    robot: int,
) -> float:
    """Return the cost of a robot's route."""
    legs, loads, behind, share = outlays
    last, home = loads.size + robot, legs.shape[0] - 1
    length, cost = 0.0, 0.0
    for place in range(count):
        node = route[place]
        length += legs[last, node]
        if behind[node] > 0.0:
            cost += share * sixth(length + legs[home, node] + behind[node])
        length += loads[node]
        last = node
    return cost + sixth(length + legs[last, home])


@part
def insert(
    outlays: Outlays,
    routes: Ints,
    counts: Longs,
    costs: Floats,
    node: int,
) -> None:
    """Insert a node where it costs least."""
    trial = np.empty(outlays.loads.size + 1, np.int32)
    best, best_robot, best_place = np.inf, 0, 0
    for robot in range(counts.size):
        count = counts[robot]
        copy_piece(routes[robot], 0, count, trial, 1)
        for place in range(count + 1):
            trial[place] = node
            cost = price(outlays, trial, count + 1, robot) - costs[robot]
            if cost < best:
                best, best_robot, best_place = cost, robot, place
            if place < count:
                trial[place] = trial[place + 1]
    for place in range(counts[best_robot], best_place, -1):
        routes[best_robot, place] = routes[best_robot, place - 1]
    routes[best_robot, best_place] = node
    counts[best_robot] += 1
    costs[best_robot] += best


@part
def _without(route: Ints, count: int, i: int, many: int, out: Ints) -> int:
    """Copy a route without its nodes i .. i+many-1; return the number of nodes."""
    copy_piece(route, 0, i, out, 0)
    copy_piece(route, i + many, count, out, i)
    return count - many


@part
def _spliced(
    route: Ints, count: int, j: int, piece: Ints, many: int, turned: bool, out: Ints
) -> int:
    """Copy a route with a piece of `many` nodes before its place j, perhaps reversed."""
    copy_piece(route, 0, j, out, 0)
    for place in range(many):
        out[j + place] = piece[many - 1 - place] if turned else piece[place]
    copy_piece(route, j, count, out, j + many)
    return count + many


@part
def _crossed(left: Ints, i: int, right: Ints, j: int, count: int, out: Ints) -> int:
    """Copy the first i nodes of one route and the nodes from place j of another."""
    copy_piece(left, 0, i, out, 0)
    copy_piece(right, j, count, out, i)
    return i + count - j


@part
def _reversed(route: Ints, count: int, i: int, j: int, out: Ints) -> int:
    """Copy a route with its nodes i .. j reversed."""
    for place in range(count):
        out[place] = route[i + j - place] if i <= place <= j else route[place]
    return count


@part
def _adopt(
    routes: Ints, counts: Longs, robot: int, trial: Ints, count: int, owner: Longs, place_of: Longs
) -> None:
    counts[robot] = count
    for place in range(count):
        node = trial[place]
        routes[robot, place] = node
        owner[node] = robot
        place_of[node] = place


@part
def nearest(legs: Floats, nodes: int, starts: int, many: int) -> Ints:
    """Return for each node the `many` nearest of the other nodes and the `starts` robots, nearest
    first.

    `many` is less than `nodes + starts`.
    """
    found = np.zeros((nodes, many), np.int32)
    cost = np.empty(many)
    for node in range(nodes):
        for place in range(many):
            cost[place] = np.inf
        for other in range(nodes + starts):
            if other == node or legs[node, other] >= cost[many - 1]:
                continue
            place = many - 1
            while place > 0 and cost[place - 1] > legs[node, other]:
                cost[place] = cost[place - 1]
                found[node, place] = found[node, place - 1]
                place -= 1
            cost[place] = legs[node, other]
            found[node, place] = other
    return found


@part
def attempt(near: Ints, starts: int, state: int) -> tuple[int, int, bool, int, bool, float, int]:
    """Draw the next attempt of the local search: bring a node beside another one or a robot.

    It relocates some nodes, perhaps reversed, or reverses or swaps pieces. Returned with it are the
    part of the heat that it may cost, and the generator's next state.
    """
    nodes = near.shape[0]
    state = draw(state)
    node = (state >> 8) % nodes
    state = draw(state)
    relocates = (state >> 8) % 10 < 6
    state = draw(state)
    other = (state >> 8) % (nodes + starts)
    state = draw(state)
    if (state >> 8) % ONE_FAR != 0:
        state = draw(state)
        other = near[node, (state >> 8) % near.shape[1]]
    state = draw(state)
    many, turned = 1 + (state >> 8) % 4, (state >> 16) % 2 == 1
    state = draw(state)
    return node, other, relocates, many, turned, (state >> 8) / 8388608.0, state


@part
def improve(
    outlays: Outlays,
    routes: Ints,
    counts: Longs,
    costs: Floats,
    moves: int,
    heat: float,
    state: int,
) -> None:
    """Improve routes in place by local search: `moves` attempts from the generator's `state`.

    A move brings a node beside another, mostly one of the nearest. It relocates up to four nodes,
    either way round, reverses a piece of a route, or swaps the tails of two. It is accepted if it
    adds less than a random part of `heat` times the whole. `heat` cools down to 0 after four fifths
    of the attempts.
    """
    legs, nodes = outlays.legs, outlays.loads.size
    owner, place_of = np.zeros(nodes, np.int64), np.zeros(nodes, np.int64)
    a, b, c = np.empty(nodes, np.int32), np.empty(nodes, np.int32), np.empty(nodes, np.int32)
    total = 0.0
    for robot in range(counts.size):
        _adopt(routes, counts, robot, routes[robot], counts[robot], owner, place_of)
        total += costs[robot]
    near = nearest(legs, nodes, counts.size, min(NEAR, nodes + counts.size - 1))
    for move in range(moves):
        node, other, relocates, many, turned, warmth, state = attempt(near, counts.size, state)
        warmth *= heat * (1.0 - 1.25 * move / moves)
        allowed = warmth * total if warmth > 0.0 else -1e-9 * total
        mine, i = owner[node], place_of[node]
        theirs, j = other - nodes, 0
        if other < nodes:
            theirs, j = owner[other], place_of[other] + 1
            if turned and relocates:
                j -= 1  # so that the node comes beside the other
        count, other_count = counts[mine], counts[theirs]
        left, right = 0, 0
        if relocates:
            many = min(many, count - i)
            if mine == theirs and i <= j <= i + many:
                continue
            piece = routes[mine, i : i + many]
            left = _without(routes[mine], count, i, many, a)
            if mine == theirs:
                copy_piece(a, 0, left, c, 0)
                left = _spliced(c, left, j - many if j > i else j, piece, many, turned, a)
            else:
                right = _spliced(routes[theirs], other_count, j, piece, many, turned, b)
        elif mine != theirs:
            left = _crossed(routes[mine], i, routes[theirs], j, other_count, a)
            right = _crossed(routes[theirs], j, routes[mine], i, count, b)
        elif min(i + 1, j) < max(i, j - 1):
            left = _reversed(routes[mine], count, min(i + 1, j), max(i, j - 1), a)
        else:
            continue
        cost, other_cost = price(outlays, a, left, mine), 0.0
        gain = cost - costs[mine]
        if mine != theirs:
            other_cost = price(outlays, b, right, theirs)
            gain += other_cost - costs[theirs]
        if gain < allowed:
            total += gain
            costs[mine] = cost
            _adopt(routes, counts, mine, a, left, owner, place_of)
            if mine != theirs:
                costs[theirs] = other_cost
                _adopt(routes, counts, theirs, b, right, owner, place_of)


@part
def improve_alone(
    legs: Floats, route: Ints, length: float, moves: int, heat: float, state: int
) -> None:
    """Improve the route of a single robot in place, as `improve`.

    With `behind` 0 everywhere the shortest route is the cheapest, and the gain of an attempt shows
    in the few legs that it changes. `route` holds all nodes; `length` is the route's with the loads
    of its nodes.
    """
    nodes = route.size
    way = np.empty(nodes + 2, np.int32)  # from the robot through the nodes home
    way[0], way[nodes + 1] = nodes, nodes + 1
    copy_piece(route, 0, nodes, way, 1)
    place_of = np.empty(nodes + 1, np.int64)
    for place in range(nodes + 1):
        place_of[way[place]] = place
    near = nearest(legs, nodes, 1, min(NEAR, nodes))
    for move in range(moves):
        node, other, relocates, many, turned, warmth, state = attempt(near, 1, state)
        warmth *= heat * (1.0 - 1.25 * move / moves)
        i, j = place_of[node], place_of[other] + 1
        last = min(i + many - 1, nodes)
        allowed = (length + 1.0) * warmth / 6.0 if warmth > 0.0 else -1e-9 * (length + 1.0)
        if relocates:  # the nodes at i .. last to between j - 1 and j
            if turned and j > 1:
                j -= 1  # so that the node comes beside the other
            if i <= j <= last + 1:
                continue
            left, right = (last, i) if turned else (i, last)
            gain = (
                legs[way[i - 1], way[last + 1]]
                - legs[way[i - 1], way[i]]
                - legs[way[last], way[last + 1]]
                + legs[way[j - 1], way[left]]
                + legs[way[right], way[j]]
                - legs[way[j - 1], way[j]]
            )
            begin, end = min(i, j), max(last + 1, j)
            if gain < allowed:
                # the piece and the nodes that it changes places with: each reversed, and both
                # together
                if not turned:
                    _turn(way, i, last)
                _turn(way, last + 1, j - 1)
                _turn(way, j, i - 1)
                _turn(way, begin, end - 1)
        else:  # the piece between the two reversed
            first, last = min(i + 1, j), max(i, j - 1)
            if first >= last:
                continue
            gain = (
                legs[way[first - 1], way[last]]
                + legs[way[first], way[last + 1]]
                - legs[way[first - 1], way[first]]
                - legs[way[last], way[last + 1]]
            )
            begin, end = first, last + 1
            if gain < allowed:
                _turn(way, first, last)
        if gain < allowed:
            length += gain
            for place in range(begin, end):
                place_of[way[place]] = place
    copy_piece(way, 1, nodes + 1, route, 0)


@part
def _turn(way: Ints, first: int, last: int) -> None:
    """Reverse the places first .. last; no change if last is before first."""
    while first < last:
        held = way[first]
        way[first] = way[last]
        way[last] = held
        first += 1
        last -= 1


@part
def _begin(
    outlays: Outlays, last: Ints, last_counts: Longs, routes: Ints, counts: Longs, costs: Floats
) -> None:
    """Take over the last routes, and insert their missing nodes."""
    placed = np.zeros(outlays.loads.size, np.bool_)
    for robot in range(counts.size):
        counts[robot] = last_counts[robot]
        for place in range(counts[robot]):
            routes[robot, place] = last[robot, place]
            placed[last[robot, place]] = True
        costs[robot] = price(outlays, routes[robot], counts[robot], robot)
    for node in range(outlays.loads.size):
        if not placed[node]:
            insert(outlays, routes, counts, costs, node)


@kernel
def arrange(
    outlays: Outlays,
    last: Ints,
    last_counts: Longs,
    moves: int,
    heat: float,
    state: int,
) -> tuple[Ints, Longs]:
    """Return routes through all nodes, and the number of nodes of each.

    Args:
        outlays: the costs of routes.
        last: routes to start from, (R, any); missing nodes are put where they cost least.
        last_counts: the number of valid nodes in each row of `last`, (R,).
        moves: attempts of the local search.
        heat: increase of the whole that an attempt may make at first, as a fraction.
        state: of the generator of random numbers, 0 .. 2^31 - 1.
    """
    nodes, robots = outlays.loads.size, last_counts.size
    routes = np.zeros((robots, nodes), np.int32)
    counts = np.empty(robots, np.int64)
    costs = np.zeros(robots, np.float64)
    _begin(outlays, last, last_counts, routes, counts, costs)
    behind = 0.0
    for node in range(nodes):
        behind = max(behind, outlays.behind[node])
    if nodes > 1 and robots == 1 and behind == 0.0:
        length = costs[0] ** (1.0 / 6.0) - 1.0
        improve_alone(outlays.legs, routes[0], length, moves, heat, state)
    elif nodes > 1:
        improve(outlays, routes, counts, costs, moves, heat, state)
    return routes, counts
