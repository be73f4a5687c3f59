"""The live page beside a flight, where its options ask for one."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from missions.errors import UavmapError
from missions.flight.setting import Setting
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.flight_plan import FlightPlan
from uavmap.runner.operator.onlooker import Onlooker
from uavmap.runner.operator.progress import ProgressTable
from uavmap.ui.page.address import LOOPBACK
from uavmap.ui.page.background import of_tiles
from uavmap.ui.page.feed import Wishes, opened
from uavmap.ui.page.live import FlightPage


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
    plan = plan() if callable(plan) else plan
    mission, wishes = plan.mission, Wishes(options.page, "--page", options.page_host)
    under = of_tiles(Path(options.tiles), Setting.of(mission)) if options.tiles else None
    config = {"title": mission.name, "steers": not plan.simulated}
    with opened(wishes, config) as feed:
        page = FlightPage(feed, simulated=plan.simulated, background=under)
        how = "was left before its end"
        try:
            with shown_on(page):
                yield table, page
            how = "is over"
        finally:
            page.close(f"the flight {how}; `uavmap watch {folder}` shows it again")
