"""The options of the live page, and the page that they ask for."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from missions.errors import UavmapError
from missions.state import Setting
from uavmap.cli.common import number_type
from uavmap.fly.onlooker import Onlooker
from uavmap.fly.progress import Progress
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


def add_rerun_option(parser: argparse.ArgumentParser) -> None:
    """Add --rerun."""
    parser.add_argument(
        "--rerun",
        metavar="FILE.rrd",
        type=Path,
        help="record frames, poses, footprints, cells, tree and batteries on one timeline, for "
        "the Rerun viewer (needs the extra rerun)",
    )


@contextlib.contextmanager
def beside(
    options: argparse.Namespace,
    plan: FlightPlan | Callable[[], FlightPlan],
    folder: Path,
    progress: Progress,
) -> Iterator[tuple[Progress, Onlooker | None]]:
    """What is beside a flight, where it is asked for: its page, and its recording.

    Who hears of the flight then, and who looks on. `plan` is asked for, if it is not at hand, only
    where there is something beside. Raises `UavmapError` where that cannot be.
    """
    known = None
    if options.page is not None or options.rerun is not None:
        known = plan() if callable(plan) else plan
    with _page_beside(options, known, folder, progress) as (heard, seen):
        if options.rerun is None or known is None:
            yield heard, seen
            return
        from uavmap.animation.rerun_flight import recorded  # noqa: PLC0415 - takes a second

        with recorded(options.rerun, known, heard, seen) as recorder:
            yield recorder, recorder


def check_beside(options: argparse.Namespace) -> None:
    """Raise `UavmapError` where a recording is asked for that cannot be: before anything else."""
    if options.rerun is not None:
        from uavmap.animation.rerun_flight import check_recording  # noqa: PLC0415 - as above

        check_recording(options.rerun)


@contextlib.contextmanager
def _page_beside(
    options: argparse.Namespace, plan: FlightPlan | None, folder: Path, progress: Progress
) -> Iterator[tuple[Progress, Onlooker | None]]:
    if options.page is None or plan is None:
        if options.tiles or options.page_host != LOOPBACK:
            raise UavmapError("--tiles and --page-host go with --page")
        yield progress, None
        return
    mission, wishes = plan.mission(), Wishes(options.page, "--page", options.page_host)
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
