"""The options of the live page, and the page that they ask for."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from missions.errors import UavmapError
from missions.state import Setting
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.cli.common import number_type
from uavmap.fly.onlooker import Onlooker
from uavmap.fly.progress import ProgressTable
from uavmap.page.address import LOOPBACK, PORT
from uavmap.page.background import of_tiles
from uavmap.page.live import FlightPage
from uavmap.page.opening import Wishes, opened
from uavmap.record.flight_plan import FlightPlan

port = number_type(int, 0, 65535)


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add --page and what goes with it."""
    parser.add_argument(
        "--page",
        metavar="PORT",
        nargs="?",
        type=port,
        const=PORT,
        help=f"show the flight live in a browser, with buttons; on port {PORT}, or another, 0 for "
        "any that is free",
    )
    add_common_options(parser)


def add_common_options(parser: argparse.ArgumentParser) -> None:
    """Add --page-host and --tiles."""
    parser.add_argument(
        "--page-host",
        metavar="ADDRESS",
        default=LOOPBACK,
        help="serve the page on this address of the computer, 0.0.0.0 for all (default: only to "
        "this computer itself); the token in its URL is needed in any case",
    )
    parser.add_argument(
        "--tiles",
        metavar="FILE.mbtiles",
        help="show the live page's map over these tiles, from a file on this computer",
    )


@contextlib.contextmanager
def beside(
    options: argparse.Namespace,
    plan: FlightPlan | Callable[[], FlightPlan],
    folder: Path,
    terminal: Terminal,
) -> Iterator[tuple[Onlooker, ...]]:
    """Show progress on the terminal, and open the live page where it is asked for.

    Args:
        options: Of the command.
        plan: Of the flight, or what reads it; read only for a page.
        folder: Of the results.
        terminal: Of the command.

    Returns:
        What looks on: the progress on the terminal, and the page.

    Raises:
        UavmapError: The page cannot be opened.
    """
    table = ProgressTable(terminal)
    if options.page is None:
        if options.tiles or options.page_host != LOOPBACK:
            raise UavmapError("--tiles and --page-host go with --page")
        yield (table,)
        return
    known = plan() if callable(plan) else plan
    mission, wishes = known.mission(), Wishes(options.page, "--page", options.page_host)
    under = of_tiles(Path(options.tiles), Setting.of(mission)) if options.tiles else None
    config = {"title": mission.name, "steers": not known.simulated}
    with opened(wishes, config) as feed:
        page = FlightPage(feed, simulated=known.simulated, background=under)
        how = "was left before its end"
        try:
            with shown_on(page):
                yield table, page
            how = "is over"
        finally:
            page.close(f"the flight {how}; `uavmap watch {folder}` shows it again")
