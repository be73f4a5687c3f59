"""The live page beside a flight, where its options ask for one."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from missions.errors import UavmapError
from missions.state import Setting
from uavmap.fly.onlooker import Onlooker
from uavmap.fly.progress import Progress
from uavmap.page.address import LOOPBACK
from uavmap.page.background import of_tiles
from uavmap.page.live import FlightPage
from uavmap.page.opening import Wishes, opened
from uavmap.record.flight_plan import FlightPlan


@contextlib.contextmanager
def beside(
    options: argparse.Namespace,
    plan: FlightPlan | Callable[[], FlightPlan],
    folder: Path,
    progress: Progress,
) -> Iterator[tuple[Progress, Onlooker | None]]:
    """Show the flight on its page, where one is asked for.

    Yields the progress and the onlooker of the flight then. `plan` is made, if it is not at hand,
    only for a page. Raises `UavmapError` where that cannot be.
    """
    if options.page is None:
        if options.tiles or options.page_host != LOOPBACK:
            raise UavmapError("--tiles and --page-host go with --page")
        yield progress, None
        return
    plan = plan() if callable(plan) else plan
    mission, wishes = plan.mission, Wishes(options.page, "--page", options.page_host)
    under = of_tiles(Path(options.tiles), Setting.of(mission)) if options.tiles else None
    config = {"title": mission.name, "steers": not plan.simulated}
    with opened(wishes, config, progress.say) as feed:
        page = FlightPage(feed, progress, simulated=plan.simulated, background=under)
        how = "was left before its end"
        try:
            yield page, page
            how = "is over"
        finally:
            page.close(f"the flight {how}; `uavmap watch {folder}` shows it again")
