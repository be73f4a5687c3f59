"""A film on the terminal: half-block characters, two cells above each other in one."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from rich.console import Console, Group
from rich.live import Live
from rich.style import Style
from rich.text import Text

from missions.units import Cell
from uavmap.animation.film import FPS, Film, Reel
from uavmap.animation.stage import HIDDEN, caption
from uavmap.clock import Clock, run
from uavmap.results.palette import STATES, Colour, track_colour
from uavmap.results.picture import PAPER

_EVERY: Final = 2
"""Of the film's frames every second is shown: ten a second."""
_LARGEST: Final = 4
"""A cell is at most so many characters wide."""
_OTHER_LINES: Final = 3

Pixels = list[list[Colour]]


def live(film: Film, console: Console, clock: Clock) -> bool:
    """Show a film on a terminal, as fast as the clock goes; the last picture stays.

    Returns False, and shows nothing, when the console is not a terminal.
    """
    if not console.is_terminal:
        return False
    with Live(console=console, auto_refresh=False) as screen:
        run(_play(film, console, screen), clock)
    return True


async def _play(film: Film, console: Console, screen: Live) -> None:
    loop, reel = asyncio.get_running_loop(), Reel(film)
    start_s, times = loop.time(), film.times()
    shown = [*range(0, len(times) - 1, _EVERY), len(times) - 1]
    for i in shown:
        for _ in reel.forward(times[i]):
            pass
        pixels = grid_of(film, reel, times[i], console.width, console.height - _OTHER_LINES)
        head = Text(f"{film.title}\n{caption(film, reel, times[i])}\n")
        screen.update(Group(head, _half_blocks(pixels)), refresh=True)
        await asyncio.sleep(max(start_s + (i + _EVERY) / FPS - loop.time(), 0.0))


def grid_of(film: Film, reel: Reel, t: float, columns: int, lines: int) -> Pixels:
    """The colours of the picture at a time, row by row from the north, an even number of rows.

    It fits in so many columns and lines of a terminal, two rows a line. Small ROIs are enlarged; of
    large ones a pixel stands for several cells and shows what is most urgent there.
    """
    west, south, east, north = film.bounds()
    across, up = east - west + 1, north - south + 1
    columns, rows = max(columns, 1), max(2 * lines, 2)
    zoom = max(min(columns // across, rows // up, _LARGEST), 1)
    shrink = max(math.ceil(across / columns), math.ceil(up / rows))
    size = math.ceil(across / shrink), math.ceil(up / shrink)
    pixels = [[PAPER] * size[0] for _ in range(size[1])]
    for cell, colour in _cells(film, reel, t):
        pixels[(north - cell.north) // shrink][(cell.east - west) // shrink] = colour
    large = [[c for c in row for _ in range(zoom)] for row in pixels for _ in range(zoom)]
    if len(large) % 2:
        large.append([PAPER] * len(large[0]))
    return large


def _cells(film: Film, reel: Reel, t: float) -> Iterator[tuple[Cell, Colour]]:
    """The colours of cells, what is urgent last: it covers what came before."""
    for state in (
        "provisional non-roi",
        "non-roi",
        "provisional",
        None,
        "explored",
        "under exploration",
        "unexplored",
        "skipped",
    ):
        if state is None:
            yield from ((cell, HIDDEN) for cell in film.roi if cell not in reel.states)
        else:
            yield from ((c, STATES[state]) for c, now in reel.states.items() if now == state)
    for robot in film.tracks:
        east, north = film.fix(robot, t).place
        yield Cell(math.floor(east + 0.5), math.floor(north + 0.5)), track_colour(robot)


def _half_blocks(pixels: Sequence[Sequence[Colour]]) -> Text:
    """Two rows of pixels to a line: the upper as foreground, the lower as background."""
    text = Text(no_wrap=True, overflow="crop")
    for upper, lower in zip(pixels[::2], pixels[1::2], strict=True):
        for (above, below), group in groupby(zip(upper, lower, strict=True)):
            style = Style(color="#{:02x}{:02x}{:02x}".format(*above))
            style += Style(bgcolor="#{:02x}{:02x}{:02x}".format(*below))
            text.append("▀" * len(list(group)), style)
        text.append("\n")
    text.rstrip()
    return text
