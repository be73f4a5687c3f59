"""Planning of flight without stopping, on arrays: paths, speed profiles, frames, local search.

A *path* is a list of pieces, lines and arcs. A *profile* turns it into segments of constant
tangential acceleration, so place and speed are exact functions of time. *Frames* taken along it at
even intervals show cells; each frame that a cell needs has a worth in seconds. `improve` searches
the cheapest waypoints of a team: seconds of flight less the worth of the frames.

All is in one module, as `missions.planning.kernels.jit` demands. Metres, seconds, radians from east
towards north.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import draw, kernel, part, team_s, uniform

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Indices = NDArray[np.int32]
Flags = NDArray[np.uint8]
Grid = tuple[int, int, int, int, float]
"""West, south, columns and rows of the window in cells, and the edge of a cell."""

# columns of a vehicle's parameters
SPEED, ACCEL, CUT, TURN_V, FRAME_S, HALF_X, HALF_Y, TILT, DRAG, WIND_X, WIND_Y = range(11)
NEXT_FRAME_S, FULL_RATE_S, FADE_1_S = 11, 12, 13
PARAMETERS = 14
# columns of a piece of a path; the speed on it and at its end are limits
P_X, P_Y, P_HEADING, P_CURVE, P_LENGTH, P_SPEED, P_END = range(7)
PIECE = 7
# columns of a segment of a profile
S_T, S_X, S_Y, S_HEADING, S_CURVE, S_V, S_A, S_COS, S_SIN = range(9)
SEGMENT = 9

MAX_PIECES = 1024
MAX_SEGMENTS = 2048
MAX_WAYPOINTS = 256
MAX_HITS = 60_000

_STRAIGHT = 0.01  # smaller turns count as straight
_REVERSAL = 2.9  # larger turns are a halt and a turn on the spot
_LEG_SHARE = 0.45  # of a leg, for an arc at either end
_MAX_TURN = 3.6  # of an arc at the beginning
_NEVER = 1e6
_NOWHERE = 1e18
_BLOCK = 4  # waypoints that are moved together, at most
_LONGEST_REVERSAL = 12
SLOW = 0.05  # slower counts as at rest
LEADS = 4
"""Ways to begin: at once, at two lower speeds, from a halt."""


class Team(NamedTuple):
    """The vehicles, a row each, and the ways in which each can begin."""

    pars: Floats
    """(vehicles, PARAMETERS)"""
    starts: Floats
    """(vehicles, LEADS, 4): x, y, heading and speed after a lead-in."""
    leads: Floats
    """(vehicles, LEADS, most, PIECE): the pieces of a lead-in."""
    n_leads: Ints
    """(vehicles, LEADS): pieces of a lead-in; -1: the vehicle cannot begin so."""
    v0: Floats
    """(vehicles,): the present speed."""


class Ways(NamedTuple):
    """The waypoints of each vehicle, which the search changes."""

    points: Floats
    """(vehicles, MAX_WAYPOINTS, 3): x, y, and the maximum cut of the corner.

    The last is the end and stays the last.
    """
    counts: Ints
    """(vehicles,): waypoints, at least 1."""
    choices: Ints
    """(vehicles,): the number of the lead-in."""
    total: Floats
    """(vehicles,): the duration, s."""


class Cells(NamedTuple):
    """The need for frames, by cell of a window."""

    worth: Floats
    """Worth of a frame, s."""
    need: Ints
    """Number of frames that are worth it."""
    cover: Ints
    """Frames to come; those of a plan are added while it is evaluated."""
    allowed: Flags
    """0 where no vehicle may be."""
    fenced: bool
    """True if there is any such place."""
    grid: Grid


class Room(NamedTuple):
    """The arrays in which one path is computed; `new_room` makes them."""

    pieces: Floats
    caps: Floats
    segs: Floats
    out: Floats
    reached: Ints


class _Hits(NamedTuple):
    """The cells that frames show, and when; a row for each vehicle and two for the trial."""

    cells: Indices
    times: Singles
    counts: Ints
    row: Ints
    """Rows of each vehicle and of the trial's two sides."""


class _Trial(NamedTuple):
    """Other waypoints for one vehicle or two."""

    points: Floats
    counts: Ints
    who: Ints
    """The two vehicles; -1 for no second one."""
    choice: Ints
    """(1,): another lead-in for the first, -1 for none."""
    block: Floats


@part
def new_room() -> Room:
    """Empty arrays for one path."""
    return Room(
        np.empty((MAX_PIECES, PIECE)),
        np.empty(MAX_PIECES + 1),
        np.empty((MAX_SEGMENTS, SEGMENT)),
        np.empty(6),
        np.empty(MAX_WAYPOINTS, np.int64),
    )


@part
def _wrap(angle: float) -> float:
    """Return the same angle between -pi and pi."""
    while angle > math.pi:
        angle -= 2.0 * math.pi
    while angle <= -math.pi:
        angle += 2.0 * math.pi
    return angle


@part
def _length(x: float, y: float) -> float:
    """Return the length of a vector; a compiled `math.hypot` rounds differently from Python's."""
    return math.sqrt(x * x + y * y)


@part
def _append(rows: Floats, n: int, row: tuple[float, ...]) -> int:
    """Write row `n` of pieces or segments, in the order of the columns; return `n` + 1."""
    for column in range(len(row)):
        rows[n, column] = row[column]
    return n + 1


@part
def _copy_rows(source: Floats, begin: int, end: int, target: Floats, at: int) -> None:
    """Copy the rows `begin` to `end` - 1 to the rows of `target` from `at` on."""
    for k in range(begin, end):
        for column in range(source.shape[1]):
            target[at + k - begin, column] = source[k, column]


# --- paths --------------------------------------------------------------------------------------
@part
def _turn_towards(
    par: Floats,
    pieces: Floats,
    n: int,
    turn_v: float,
    x: float,
    y: float,
    heading: float,
    to_x: float,
    to_y: float,
) -> tuple[int, float, float, float, float]:
    """Append an arc onto the line to a point: (pieces, x, y, heading, length of the line).

    -1 pieces if the point lies inside the arc, or behind.
    """
    dx, dy = to_x - x, to_y - y
    side = 1.0 if math.cos(heading) * dy - math.sin(heading) * dx >= 0.0 else -1.0
    radius = turn_v * turn_v / par[ACCEL]
    cx = x - side * radius * math.sin(heading)
    cy = y + side * radius * math.cos(heading)
    away = _length(to_x - cx, to_y - cy)
    if away <= radius * 1.01:
        return -1, x, y, heading, 0.0
    length = math.sqrt(away * away - radius * radius)
    toward = math.atan2(to_y - cy, to_x - cx) + side * math.atan2(radius, length)
    turn = side * (toward - heading)
    while turn < -1e-9:
        turn += 2.0 * math.pi
    while turn >= 2.0 * math.pi - 1e-9:
        turn -= 2.0 * math.pi
    if turn > _MAX_TURN:
        return -1, x, y, heading, 0.0
    if turn <= 1e-4:  # the line is drawn from its beginning, or it ends beside the point
        return n, x, y, math.atan2(dy, dx), _length(dx, dy)
    n = _append(pieces, n, (x, y, heading, side / radius, radius * turn, turn_v, par[SPEED]))
    x = cx + side * radius * math.sin(toward)
    y = cy - side * radius * math.cos(toward)
    return n, x, y, toward, length


@part
def _cut_corner(
    par: Floats,
    pieces: Floats,
    n: int,
    x: float,
    y: float,
    toward: float,
    length: float,
    before: float,
    after: float,
    turn: float,
    point: Floats,
) -> tuple[int, float, float, float]:
    """Append a line and an arc around a waypoint: (pieces, x, y, length of the next line).

    The arc begins `ahead` of the corner: as far as the allowed cut demands, at most a part of
    either leg.
    """
    speed, accel = par[SPEED], par[ACCEL]
    size = abs(turn)
    cos, tan = math.cos(size / 2.0), math.tan(size / 2.0)
    ahead = min(point[2] * cos / (1.0 - cos) * tan, _LEG_SHARE * min(before, after))
    radius = ahead / tan
    n = _append(pieces, n, (x, y, toward, 0.0, length - ahead, speed, speed))
    x = point[0] - ahead * math.cos(toward)
    y = point[1] - ahead * math.sin(toward)
    slow = min(speed, math.sqrt(accel * radius))
    bend = math.copysign(1.0 / radius, turn)
    n = _append(pieces, n, (x, y, toward, bend, radius * size, slow, speed))
    x = point[0] + ahead * math.cos(toward + turn)
    y = point[1] + ahead * math.sin(toward + turn)
    return n, x, y, after - ahead


@part
def _lay_pieces(team: Team, v: int, choice: int, way: Floats, m: int, room: Room) -> int:
    """Append lead-in, then waypoints; return the number of pieces, or -1 if they cannot be flown.

    After the lead-in the vehicle continues with an arc; at rest it turns on the spot. `way` has `m`
    >= 1 waypoints, the last is the end. `room.reached` gets for each waypoint the piece at whose
    end it is passed.
    """
    par, pieces, reached = team.pars[v], room.pieces, room.reached
    x, y, heading = team.starts[v, choice, 0], team.starts[v, choice, 1], team.starts[v, choice, 2]
    turn_v = team.starts[v, choice, 3] if choice < LEADS - 1 else 0.0
    n = team.n_leads[v, choice]
    if n < 0:
        return -1
    _copy_rows(team.leads[v, choice], 0, n, pieces, 0)
    if turn_v < SLOW:
        if n > 0:
            pieces[n - 1, P_END] = 0.0
        dx, dy = way[0, 0] - x, way[0, 1] - y
        length = _length(dx, dy)
        toward = math.atan2(dy, dx) if length > 1e-6 else heading
    else:
        n, x, y, toward, length = _turn_towards(
            par, pieces, n, turn_v, x, y, heading, way[0, 0], way[0, 1]
        )
        if n < 0:
            return -1
    # an arc may begin at once where nothing else bends this leg, but not from rest
    before = length if turn_v < SLOW else length / _LEG_SHARE
    for i in range(m - 1):
        reached[i] = n
        dx, dy = way[i + 1, 0] - way[i, 0], way[i + 1, 1] - way[i, 1]
        after = _length(dx, dy)
        if after < 1e-6:
            continue
        if n + 4 >= MAX_PIECES:
            return -1
        onward = math.atan2(dy, dx)
        if before < 1e-6:  # the first waypoint is the vehicle's place
            toward, before, length = onward, after, after
            continue
        turn = _wrap(onward - toward)
        if _STRAIGHT <= abs(turn) <= _REVERSAL:
            reached[i] = n + 1
            n, x, y, length = _cut_corner(
                par, pieces, n, x, y, toward, length, before, after, turn, way[i]
            )
        else:
            end = 0.0 if abs(turn) > _REVERSAL else par[SPEED]
            n = _append(pieces, n, (x, y, toward, 0.0, length, par[SPEED], end))
            x, y, length = way[i, 0], way[i, 1], after
        toward, before = onward, after
    reached[m - 1] = n
    return _append(pieces, n, (x, y, toward, 0.0, length, par[SPEED], 0.0))


# --- profiles -----------------------------------------------------------------------------------
@part
def _limit_speeds(par: Floats, pieces: Floats, n: int, caps: Floats) -> None:
    """Compute the highest speed before each piece from which the rest can be flown."""
    for i in range(n):
        caps[i] = min(par[SPEED], pieces[i, P_SPEED])
        if i > 0:
            caps[i] = min(caps[i], pieces[i - 1, P_SPEED], pieces[i - 1, P_END])
    caps[n] = 0.0
    for i in range(n - 1, -1, -1):
        ahead = caps[i + 1]
        if pieces[i, P_CURVE] == 0.0:
            ahead = math.sqrt(ahead * ahead + 2.0 * par[ACCEL] * pieces[i, P_LENGTH])
        caps[i] = min(caps[i], ahead)


@part
def _fly_line(
    segs: Floats, n: int, t: float, piece: Floats, start: float, end: float, accel: float
) -> tuple[int, float]:
    """Append segments up, level, down, from the speed `start` to `end`: (segments, time)."""
    x, y, heading, length = piece[P_X], piece[P_Y], piece[P_HEADING], piece[P_LENGTH]
    cos, sin = math.cos(heading), math.sin(heading)
    peak = min(piece[P_SPEED], math.sqrt(0.5 * (start * start + end * end) + accel * length))
    peak = max(peak, start, end)
    up = (peak * peak - start * start) / (2.0 * accel)
    down = (peak * peak - end * end) / (2.0 * accel)
    flat = max(0.0, length - up - down)
    if peak > start + 1e-9:
        n = _append(segs, n, (t, x, y, heading, 0.0, start, accel, cos, sin))
        t += (peak - start) / accel
    if flat > 1e-9 and peak > 1e-6:
        n = _append(segs, n, (t, x + up * cos, y + up * sin, heading, 0.0, peak, 0.0, cos, sin))
        t += flat / peak
    if peak > end + 1e-9:
        at = up + flat
        n = _append(segs, n, (t, x + at * cos, y + at * sin, heading, 0.0, peak, -accel, cos, sin))
        t += (peak - end) / accel
    return n, t


@part
def profile(
    par: Floats, pieces: Floats, n: int, v0: float, caps: Floats, segs: Floats
) -> tuple[int, float]:
    """Compute the segments of a path from the speed `v0`: (their number, seconds).

    (-1, 0) if that is impossible. Arcs are flown at one speed, lines with even acceleration up and
    down; the end is a halt.
    """
    if n == 0:
        return 0, 0.0
    _limit_speeds(par, pieces, n, caps)
    if v0 > caps[0] + 0.02:
        return -1, 0.0
    accel = par[ACCEL]
    start = min(v0, caps[0])
    t, count = 0.0, 0
    for i in range(n):
        if count + 3 >= MAX_SEGMENTS:
            return -1, 0.0
        curve, length = pieces[i, P_CURVE], pieces[i, P_LENGTH]
        if curve == 0.0:
            end = min(caps[i + 1], math.sqrt(start * start + 2.0 * accel * length))
            count, t = _fly_line(segs, count, t, pieces[i], start, end, accel)
            start = end
            continue
        if start < SLOW:  # no vehicle flies an arc from rest
            return -1, 0.0
        heading = pieces[i, P_HEADING]
        x, y, cos, sin = pieces[i, P_X], pieces[i, P_Y], math.cos(heading), math.sin(heading)
        count = _append(segs, count, (t, x, y, heading, curve, start, 0.0, cos, sin))
        t += length / start
    return count, t


@part
def place(segs: Floats, i: int, dt: float, out: Floats) -> None:
    """Write into `out`: x, y, v_x, v_y, a_x, a_y in segment `i`, `dt` seconds after its begin."""
    v = segs[i, S_V] + segs[i, S_A] * dt
    s = (segs[i, S_V] + 0.5 * segs[i, S_A] * dt) * dt
    curve = segs[i, S_CURVE]
    cos, sin = segs[i, S_COS], segs[i, S_SIN]
    if curve == 0.0:
        out[0] = segs[i, S_X] + s * cos
        out[1] = segs[i, S_Y] + s * sin
        out[4] = segs[i, S_A] * cos
        out[5] = segs[i, S_A] * sin
    else:
        heading = segs[i, S_HEADING] + s * curve
        cos2, sin2 = math.cos(heading), math.sin(heading)
        out[0] = segs[i, S_X] + (sin2 - sin) / curve
        out[1] = segs[i, S_Y] - (cos2 - cos) / curve
        cos, sin = cos2, sin2
        out[4] = -v * v * curve * sin
        out[5] = v * v * curve * cos
    out[2] = v * cos
    out[3] = v * sin


@part
def _along(piece: Floats, way: float) -> tuple[float, float, float]:
    """Return (x, y, heading) `way` metres into a piece."""
    x, y, h, curve = piece[P_X], piece[P_Y], piece[P_HEADING], piece[P_CURVE]
    if curve == 0.0:
        return x + way * math.cos(h), y + way * math.sin(h), h
    h2 = h + way * curve
    x += (math.sin(h2) - math.sin(h)) / curve
    y -= (math.cos(h2) - math.cos(h)) / curve
    return x, y, h2


@kernel
def lead_in(
    par: Floats,
    pieces: Floats,
    n: int,
    first: int,
    start: float,
    v: float,
    slow: float,
    lead: Floats,
    end: Floats,
) -> int:
    """Compute the rest of a path from `start` metres into piece `first` until the speed is `slow`.

    Pieces go into `lead`, their end (x, y, heading, speed) into `end`. Return their number, -1 if
    `lead` is too short.
    """
    accel = par[ACCEL]
    count = 0
    x, y, h = 0.0, 0.0, 0.0
    for i in range(first, n):
        begun = start if i == first else 0.0
        x, y, h = _along(pieces[i], begun)
        if v <= slow + 1e-6:
            break
        if count >= lead.shape[0]:
            return -1
        take = max(0.0, pieces[i, P_LENGTH] - begun)
        done = False
        if pieces[i, P_CURVE] == 0.0:
            needed = (v * v - slow * slow) / (2.0 * accel)
            done = take >= needed - 1e-9
            take = min(take, needed)
            v = slow if done else math.sqrt(v * v - 2.0 * accel * take)
        if take > 1e-9:
            row = (x, y, h, pieces[i, P_CURVE], take, pieces[i, P_SPEED], par[SPEED])
            count = _append(lead, count, row)
        x, y, h = _along(pieces[i], begun + take)
        if done:
            break
    end[0], end[1], end[2], end[3] = x, y, h, v
    return count


@kernel
def fly(team: Team, v: int, choice: int, way: Floats, m: int, room: Room) -> tuple[int, int, float]:
    """Return path and profile of vehicle `v`: (pieces, segments, seconds); `_NEVER` without one.

    `choice` is its lead-in: the last is a halt, from which all can be flown.
    """
    n = _lay_pieces(team, v, choice, way, m, room)
    if n < 0:
        return 0, 0, _NEVER
    count, total = profile(team.pars[v], room.pieces, n, team.v0[v], room.caps, room.segs)
    if count < 0:
        return 0, 0, _NEVER
    return n, count, total


# --- frames -------------------------------------------------------------------------------------
@kernel
def frames(
    par: Floats,
    segs: Floats,
    n: int,
    total_s: float,
    grid: Grid,
    cells: Indices,
    times: Singles,
    out: Floats,
) -> int:
    """Fill in the cells that the frames along a profile show, and the times; return their number.

    Frames farther in the future than FULL_RATE_S are computed one in two, and count twice.
    """
    west, south, width, height, cell_m = grid
    count, i = 0, 0
    t = par[NEXT_FRAME_S]
    half_x, half_y, tilt, drag = par[HALF_X], par[HALF_Y], par[TILT], par[DRAG]
    while t < total_s and n > 0:
        while i + 1 < n and segs[i + 1, S_T] <= t:
            i += 1
        dt = t - segs[i, S_T]
        if tilt == 0.0 and segs[i, S_CURVE] == 0.0:  # most of all frames
            s = (segs[i, S_V] + 0.5 * segs[i, S_A] * dt) * dt
            x, y = segs[i, S_X] + s * segs[i, S_COS], segs[i, S_Y] + s * segs[i, S_SIN]
        else:
            place(segs, i, dt, out)
            x = out[0] - tilt * (out[4] + drag * (out[2] - par[WIND_X]))
            y = out[1] - tilt * (out[5] + drag * (out[3] - par[WIND_Y]))
        i0 = max(0, math.ceil((x - half_x) / cell_m) - west)
        i1 = min(width - 1, math.floor((x + half_x) / cell_m) - west)
        j0 = max(0, math.ceil((y - half_y) / cell_m) - south)
        j1 = min(height - 1, math.floor((y + half_y) / cell_m) - south)
        times_each = 2 if t > par[FULL_RATE_S] else 1
        if i1 >= i0 and j1 >= j0:
            if count + times_each * (i1 - i0 + 1) * (j1 - j0 + 1) > cells.shape[0]:
                return count
            for j in range(j0, j1 + 1):
                for k in range(i0, i1 + 1):
                    for _ in range(times_each):
                        cells[count] = j * width + k
                        times[count] = t
                        count += 1
        t += times_each * par[FRAME_S]
    return count


@part
def _cover(
    shown: Indices, times: Singles, n: int, cells: Cells, urgent: float, fade: float, step: int
) -> float:
    """Add frames to the cover (`step` 1), or take back the last ones added (`step` -1).

    Return their worth in seconds; a worth below `urgent` fades with time.
    """
    worth, need, cover = cells.worth, cells.need, cells.cover
    gain = 0.0
    k = 0 if step > 0 else n - 1
    for _ in range(n):
        c = shown[k]
        if step < 0:
            cover[c] -= 1
        if cover[c] < need[c]:
            later = 1.0 if worth[c] >= urgent else max(0.0, 1.0 - fade * times[k])
            gain += worth[c] * later
        if step > 0:
            cover[c] += 1
        k += step
    return gain


@kernel
def worth_of_rest(
    par: Floats,
    segs: Floats,
    n: int,
    total_s: float,
    since_s: float,
    cells: Cells,
    urgent: float,
) -> float:
    """Return the worth of the frames on the rest of a path that was begun `since_s` ago.

    They are added to the cover.
    """
    out = np.empty(6)
    shown, times = np.empty(MAX_HITS, np.int32), np.empty(MAX_HITS, np.float32)
    held = par[NEXT_FRAME_S], par[FULL_RATE_S]
    par[NEXT_FRAME_S] += since_s
    par[FULL_RATE_S] += since_s
    count = frames(par, segs, n, total_s, cells.grid, shown, times, out)
    par[NEXT_FRAME_S], par[FULL_RATE_S] = held
    for k in range(count):
        times[k] -= since_s
    return _cover(shown, times, count, cells, urgent, par[FADE_1_S], 1)


@part
def _forbidden(segs: Floats, n: int, total_s: float, cells: Cells, out: Floats) -> bool:
    """Return whether a profile leads over a cell that is not allowed."""
    west, south, width, height, cell_m = cells.grid
    i = 0
    t = 0.0
    while t < total_s and i < n:
        while i + 1 < n and segs[i + 1, S_T] <= t:
            i += 1
        place(segs, i, t - segs[i, S_T], out)
        a = math.floor(out[0] / cell_m + 0.5) - west
        b = math.floor(out[1] / cell_m + 0.5) - south
        if a < 0 or b < 0 or a >= width or b >= height or cells.allowed[b * width + a] == 0:
            return True
        t += 0.3
    return False


# --- what a plan costs --------------------------------------------------------------------------
@part
def _evaluate(
    v: int,
    choice: int,
    way: Floats,
    m: int,
    team: Team,
    cells: Cells,
    room: Room,
    hits: _Hits,
    row: int,
) -> float:
    """Return the duration of a vehicle's way, s; its frames go into a row of `hits`."""
    hits.counts[row] = 0
    _, count, total = fly(team, v, choice, way, m, room)
    if total >= _NEVER:
        return _NEVER
    if cells.fenced and _forbidden(room.segs, count, total, cells, room.out):
        return _NEVER
    hits.counts[row] = frames(
        team.pars[v], room.segs, count, total, cells.grid, hits.cells[row], hits.times[row],
        room.out,
    )  # fmt: skip
    return total


# --- what is tried ------------------------------------------------------------------------------
@part
def _cheapest(
    way: Floats, m: int, start_x: float, start_y: float, x: float, y: float
) -> tuple[int, float]:
    """Return the waypoint of `m` before which a new one makes the least detour: (index, metres)."""
    best, best_m = 0, _NOWHERE
    px, py = start_x, start_y
    for k in range(m):
        qx, qy = way[k, 0], way[k, 1]
        detour = _length(x - px, y - py) + _length(qx - x, qy - y) - _length(qx - px, qy - py)
        if detour < best_m:
            best, best_m = k, detour
        px, py = qx, qy
    return best, best_m


@part
def _insert(way: Floats, m: int, at: int, x: float, y: float, cut: float) -> int:
    for k in range(m, at, -1):
        for axis in range(3):
            way[k, axis] = way[k - 1, axis]
    way[at, 0] = x
    way[at, 1] = y
    way[at, 2] = cut
    return m + 1


@part
def _remove(way: Floats, m: int, at: int, length: int) -> int:
    _copy_rows(way, at + length, m, way, at)
    return m - length


@part
def _begin_trial(trial: _Trial, side: int, v: int, ways: Ways) -> None:
    """Copy the waypoints of a vehicle to a side of the trial."""
    m = ways.counts[v]
    trial.who[side] = v
    trial.counts[side] = m
    _copy_rows(ways.points[v], 0, m, trial.points[side], 0)


@part
def _most_missed(cells: Cells, candidates: Ints, random: Ints) -> int:
    """Return the drawn cell of six with the most worth of missing frames; -1 without any."""
    worst, found = 0.0, -1
    if candidates.shape[0] == 0:
        return found
    for _ in range(6):
        c = candidates[draw(random, candidates.shape[0])]
        missing = (cells.need[c] - cells.cover[c]) * cells.worth[c]
        if missing > worst:
            worst, found = missing, int(c)
    return found


@part
def _show(
    c: int, v: int, nearest: bool, team: Team, ways: Ways, cells: Cells, random: Ints, trial: _Trial
) -> bool:
    """Add a waypoint from which a cell is seen, for `v` or for the nearest vehicle."""
    west, south, width, _, cell_m = cells.grid
    lattice = 0.5 * cell_m
    reach_x = int(team.pars[v, HALF_X] / lattice)
    reach_y = int(team.pars[v, HALF_Y] / lattice)
    x = (c % width + west) * cell_m + lattice * (draw(random, 2 * reach_x + 1) - reach_x)
    y = (c // width + south) * cell_m + lattice * (draw(random, 2 * reach_y + 1) - reach_y)
    vehicles = ways.counts.shape[0]
    if nearest:
        least = _NOWHERE
        for w in range(vehicles):
            _, detour = _cheapest(
                ways.points[w], ways.counts[w], team.starts[w, 1, 0], team.starts[w, 1, 1], x, y
            )
            if vehicles > 1:  # about three quarters of the seconds of its way in metres
                detour += 1.5 * ways.total[w]
            if detour < least and ways.counts[w] + 1 < MAX_WAYPOINTS:
                v, least = w, detour
    if ways.counts[v] + 1 >= MAX_WAYPOINTS:
        return False
    _begin_trial(trial, 0, v, ways)
    way, m = trial.points[0], trial.counts[0]
    at, _ = _cheapest(way, m, team.starts[v, 1, 0], team.starts[v, 1, 1], x, y)
    trial.counts[0] = _insert(way, m, at, x, y, team.pars[v, CUT])
    return True


@part
def _bend(trial: _Trial, random: Ints) -> bool:
    """Cut a corner twice as far, or half."""
    k = draw(random, trial.counts[0] - 1)
    trial.points[0, k, 2] *= 2.0 if uniform(random) < 0.5 else 0.5
    return bool(0.2 <= trial.points[0, k, 2] <= 20.0)


@part
def _shift(trial: _Trial, lattice: float, random: Ints) -> bool:
    """Move a waypoint a little."""
    k = draw(random, trial.counts[0] - 1)
    far = 1 + draw(random, 3)
    trial.points[0, k, 0] += lattice * (draw(random, 2 * far + 1) - far)
    trial.points[0, k, 1] += lattice * (draw(random, 2 * far + 1) - far)
    return True


@part
def _turn_round(trial: _Trial, random: Ints) -> bool:
    """Reverse a part of the way."""
    m = trial.counts[0]
    k = draw(random, m - 1)
    end = min(k + 1 + draw(random, min(_LONGEST_REVERSAL, m - 1 - k)), m - 2)
    while k < end:
        for axis in range(3):
            held = trial.points[0, k, axis]
            trial.points[0, k, axis] = trial.points[0, end, axis]
            trial.points[0, end, axis] = held
        k += 1
        end -= 1
    return True


@part
def _take_block(trial: _Trial, random: Ints) -> int:
    """Cut some waypoints out of the first way into the block; returns their number."""
    m = trial.counts[0]
    k = draw(random, m - 1)
    length: int = min(1 + draw(random, _BLOCK), m - 1 - k)
    _copy_rows(trial.points[0], k, k + length, trial.block, 0)
    trial.counts[0] = _remove(trial.points[0], m, k, length)
    return length


@part
def _put_block(trial: _Trial, side: int, at: int, length: int, random: Ints) -> None:
    """Insert the block, forwards or backwards."""
    back = uniform(random) < 0.5
    for b in range(length):
        point = trial.block[b if back else length - 1 - b]
        trial.counts[side] = _insert(
            trial.points[side], trial.counts[side], at, point[0], point[1], point[2]
        )


@part
def _hand_over(u: int, team: Team, ways: Ways, random: Ints, trial: _Trial) -> bool:
    """Give some waypoints of the first vehicle to `u`."""
    if ways.counts[u] + _BLOCK >= MAX_WAYPOINTS:
        return False
    _begin_trial(trial, 1, u, ways)
    length = _take_block(trial, random)
    at, _ = _cheapest(
        trial.points[1], trial.counts[1], team.starts[u, 1, 0], team.starts[u, 1, 1],
        trial.block[0, 0], trial.block[0, 1],
    )  # fmt: skip
    _put_block(trial, 1, at, length, random)
    return True


@part
def _swap_tails(v: int, u: int, ways: Ways, random: Ints, trial: _Trial) -> bool:
    """Exchange the later waypoints of two vehicles; each keeps its own end."""
    m, m2 = ways.counts[v], ways.counts[u]
    k, k2 = draw(random, m - 1), draw(random, m2)
    new_m, new_m2 = k + (m2 - k2), k2 + (m - k)
    if new_m >= MAX_WAYPOINTS or new_m2 >= MAX_WAYPOINTS:
        return False
    _begin_trial(trial, 1, u, ways)
    _copy_rows(ways.points[u], k2, m2 - 1, trial.points[0], k)
    _copy_rows(ways.points[v], k, m - 1, trial.points[1], k2)
    _copy_rows(ways.points[v], m - 1, m, trial.points[0], new_m - 1)
    _copy_rows(ways.points[u], m2 - 1, m2, trial.points[1], new_m2 - 1)
    trial.counts[0], trial.counts[1] = new_m, new_m2
    return True


@part
def _propose(
    turn: int,
    team: Team,
    ways: Ways,
    cells: Cells,
    candidates: Ints,
    urgent: float,
    random: Ints,
    trial: _Trial,
) -> bool:
    """Draw a change into the trial, at first one that shows each candidate in its turn.

    Return whether there is a change.
    """
    trial.who[1] = -1
    trial.choice[0] = -1
    if turn < candidates.shape[0]:
        c = candidates[turn]
        return bool(
            cells.worth[c] >= urgent
            and cells.cover[c] < cells.need[c]
            and _show(c, 0, True, team, ways, cells, random, trial)
        )
    vehicles = ways.counts.shape[0]
    kind = uniform(random)
    v = draw(random, vehicles) if vehicles > 1 else 0
    if kind < 0.3:
        c = _most_missed(cells, candidates, random)
        nearest = uniform(random) < 0.5
        return bool(c >= 0 and _show(c, v, nearest, team, ways, cells, random, trial))
    m = ways.counts[v]
    _begin_trial(trial, 0, v, ways)
    if kind < 0.33 or m < 2:  # another lead-in
        trial.choice[0] = draw(random, LEADS)
        return bool(team.v0[v] >= SLOW and trial.choice[0] != ways.choices[v])
    if kind < 0.4:
        return _bend(trial, random)
    if kind < 0.65:
        return _shift(trial, 0.5 * cells.grid[4], random)
    if kind < 0.78:
        trial.counts[0] = _remove(trial.points[0], m, draw(random, m - 1), 1)
        return True
    if kind < 0.88 or vehicles == 1:
        if m < 3:
            return False
        if kind < 0.83 or (vehicles == 1 and kind < 0.89):
            return _turn_round(trial, random)
        length = _take_block(trial, random)
        _put_block(trial, 0, draw(random, trial.counts[0]), length, random)
        return True
    u = draw(random, vehicles)
    if u == v:
        return False
    if kind < 0.96:
        return _hand_over(u, team, ways, random, trial)
    return _swap_tails(v, u, ways, random, trial)


# --- the search ---------------------------------------------------------------------------------
@part
def _keep_trial(trial: _Trial, after: Floats, ways: Ways, hits: _Hits) -> None:
    """Make the trial the plan; the rows of `hits` change places."""
    vehicles = ways.counts.shape[0]
    for v in range(vehicles):
        ways.total[v] = after[v]
    if trial.choice[0] >= 0:
        ways.choices[trial.who[0]] = trial.choice[0]
    for side in range(2):
        w = trial.who[side]
        if w < 0:
            continue
        m = trial.counts[side]
        _copy_rows(trial.points[side], 0, m, ways.points[w], 0)
        ways.counts[w] = m
        spare = hits.row[vehicles + side]
        hits.row[vehicles + side] = hits.row[w]
        hits.row[w] = spare


@part
def _copy(source: Ways, target: Ways) -> None:
    for v in range(source.counts.shape[0]):
        _copy_rows(source.points[v], 0, source.counts[v], target.points[v], 0)
        target.counts[v] = source.counts[v]
        target.choices[v] = source.choices[v]
        target.total[v] = source.total[v]


@part
def _cover_row(hits: _Hits, row: int, cells: Cells, urgent: float, fade: float, step: int) -> float:
    return _cover(hits.cells[row], hits.times[row], hits.counts[row], cells, urgent, fade, step)


@part
def _count_row(hits: _Hits, row: int, cover: Ints, step: int) -> None:
    """Add the frames of a row to the cover, or take them back, whatever they are worth."""
    for k in range(hits.counts[row]):
        cover[hits.cells[row, k]] += step


@part
def _cover_plan(
    hits: _Hits, vehicles: int, cells: Cells, urgent: float, fade: float, step: int
) -> float:
    gain = 0.0
    for v in range(vehicles):
        gain += _cover_row(hits, hits.row[v], cells, urgent, fade, step)
    return gain


@part
def _evaluate_plan(team: Team, ways: Ways, cells: Cells, room: Room, hits: _Hits) -> None:
    for v in range(ways.counts.shape[0]):
        ways.total[v] = _evaluate(
            v, ways.choices[v], ways.points[v], ways.counts[v], team, cells, room, hits, v
        )


@part
def _weigh(
    trial: _Trial,
    team: Team,
    ways: Ways,
    cells: Cells,
    room: Room,
    hits: _Hits,
    urgent: float,
    after: Floats,
) -> float:
    """Return the gain of the trial over the plan, s; cover its frames instead of the plan's.

    `after` gets the seconds by vehicle.
    """
    vehicles = ways.counts.shape[0]
    fade = team.pars[0, FADE_1_S]
    gain = 0.0
    for v in range(vehicles):
        after[v] = ways.total[v]
    for side in range(2):
        w = trial.who[side]
        if w >= 0:
            gain -= _cover_row(hits, hits.row[w], cells, urgent, fade, -1)
    for side in range(2):
        w = trial.who[side]
        if w < 0:
            continue
        choice = ways.choices[w]
        if side == 0 and trial.choice[0] >= 0:
            choice = trial.choice[0]
        row = hits.row[vehicles + side]
        after[w] = _evaluate(
            w, choice, trial.points[side], trial.counts[side], team, cells, room, hits, row
        )
        gain += _cover_row(hits, row, cells, urgent, fade, 1)
    return gain


@part
def _undo(trial: _Trial, cells: Cells, hits: _Hits, vehicles: int) -> None:
    """Cover the frames of the plan instead of the trial's."""
    for side in range(1, -1, -1):
        if trial.who[side] >= 0:
            _count_row(hits, hits.row[vehicles + side], cells.cover, -1)
    for side in range(2):
        if trial.who[side] >= 0:
            _count_row(hits, hits.row[trial.who[side]], cells.cover, 1)


@kernel
def improve(
    team: Team,
    ways: Ways,
    cells: Cells,
    candidates: Ints,
    moves: int,
    hot: float,
    cold: float,
    urgent: float,
    last: float,
    random: Ints,
) -> float:
    """Search cheaper waypoints, in place; return the cost in seconds.

    First every cell of `candidates` whose frames are worth `urgent` or more is shown, if that pays.
    Then follow `moves` of annealing from the temperature `hot` to `cold` (seconds). `last` is the
    share of the last vehicle in a team's time. `random` is the state of the random numbers: the
    same state gives the same result.
    """
    vehicles = ways.counts.shape[0]
    fade = team.pars[0, FADE_1_S]
    room = new_room()
    hits = _Hits(
        np.empty((vehicles + 2, MAX_HITS), np.int32),
        np.empty((vehicles + 2, MAX_HITS), np.float32),
        np.zeros(vehicles + 2, np.int64),
        np.arange(vehicles + 2),
    )
    trial = _Trial(
        np.empty((2, MAX_WAYPOINTS, 3)),
        np.zeros(2, np.int64),
        np.zeros(2, np.int64),
        np.zeros(1, np.int64),
        np.empty((_BLOCK, 3)),
    )
    _evaluate_plan(team, ways, cells, room, hits)
    gain = _cover_plan(hits, vehicles, cells, urgent, fade, 1)
    cost = team_s(ways.total, last) - gain
    best = Ways(ways.points.copy(), ways.counts.copy(), ways.choices.copy(), ways.total.copy())
    best_cost = cost
    after = np.empty(vehicles)
    temperature = hot
    cooling = (cold / hot) ** (1.0 / max(1, moves))
    for turn in range(candidates.shape[0] + moves):
        if turn >= candidates.shape[0]:
            temperature *= cooling
        if not _propose(turn, team, ways, cells, candidates, urgent, random, trial):
            continue
        more = _weigh(trial, team, ways, cells, room, hits, urgent, after)
        new_cost = team_s(after, last) - gain - more
        rise = new_cost - cost
        # exp never overflows: a lower cost is accepted before it
        uphill = turn >= candidates.shape[0] and (
            rise < 0.0 or uniform(random) < math.exp(-rise / temperature)
        )
        if rise >= 0.0 and not uphill:
            _undo(trial, cells, hits, vehicles)
            continue
        cost, gain = new_cost, gain + more
        _keep_trial(trial, after, ways, hits)
        if cost < best_cost - 1e-9:
            best_cost = cost
            _copy(ways, best)
    _cover_plan(hits, vehicles, cells, urgent, fade, -1)
    _copy(best, ways)
    return best_cost
