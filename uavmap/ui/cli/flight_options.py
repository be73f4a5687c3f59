"""Options of a command as a flight with its live page, and the flight itself."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from missions.errors import LinkError, NotFlownError, UavmapError, leaves
from missions.flight.setting_of import setting_of
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.flight_plan import KEY_VARIABLE, FleetNetwork, FlightOptions, FlightPlan
from uavmap.journal.results_folder import results_folder
from uavmap.photos.after_flight import draw_ground
from uavmap.runner.flight import fly
from uavmap.runner.ground_survey import with_ground
from uavmap.runner.operator.company import Company, Onlooker, Preflight
from uavmap.runner.operator.progress import ProgressTable
from uavmap.ui.cli import AIRCRAFT_DOWN, INCOMPLETE, complain
from uavmap.ui.cli.common import report
from uavmap.ui.cli.option_table import FLEET_KEY_VARIABLE, TABLE
from uavmap.ui.page.feed import LOOPBACK, serve_page
from uavmap.ui.page.live import FlightPage
from uavmap.ui.page.live_board import LiveBoard, Reader
from uavmap.ui.page.page_scene import background_from_tiles
from uavmap.ui.tak.tak_feed import UPDATE_S, open_tak_link


@contextlib.contextmanager
def onlookers_for(
    options: argparse.Namespace,
    plan: FlightPlan | Callable[[], FlightPlan],
    folder: Path,
    terminal: Terminal,
) -> Iterator[tuple[Onlooker, ...]]:
    """Show progress on the terminal, and on page and TAK if chosen; yield the onlookers.

    `plan` is read only for page and TAK. Raises `UavmapError`.
    """
    table = ProgressTable(terminal)
    if options.page is None and (options.tiles or options.page_host != LOOPBACK):
        raise UavmapError("--tiles and --page-host need --page; add it")
    if options.page is None and options.tak is None:
        yield (table,)
        return
    plan = plan() if callable(plan) else plan
    with contextlib.ExitStack() as stack:
        readers = []
        if options.tak is not None:
            link = stack.enter_context(open_tak_link(options.tak, simulated=plan.simulated))
            readers = [Reader(link, UPDATE_S, reports=True)]
        board = (
            LiveBoard(readers, simulated=plan.simulated)
            if options.page is None
            else stack.enter_context(_page(options, plan, folder, readers))
        )
        how = "was interrupted"
        try:
            with shown_on(board):
                yield table, board
            how = "is over"
        finally:
            board.close(f"the flight {how}; `uavmap watch {folder}` shows it again")


@contextlib.contextmanager
def _page(
    options: argparse.Namespace, plan: FlightPlan, folder: Path, others: Sequence[Reader]
) -> Iterator[FlightPage]:
    mission = plan.mission
    under = (
        background_from_tiles(Path(options.tiles), setting_of(mission)) if options.tiles else None
    )
    config = {
        "title": mission.name,
        "steers": not plan.simulated,
        "folder": str(folder.absolute()),
    }
    with serve_page(config, options.page, "--page", options.page_host) as feed:
        yield FlightPage(feed, simulated=plan.simulated, background=under, others=others)


def flight_options(options: argparse.Namespace, **more: Any) -> FlightOptions:
    """Create the options of a flight from those of its command; `more` are other fields.

    Raises `UavmapError`, and `LinkError` for an empty key.
    """
    given: dict[str, Any] = {}
    for option in TABLE:
        if option.field is not None and hasattr(options, option.destination):
            value = getattr(options, option.destination)
            given[option.field] = tuple(value or ()) if option.several else value
    given["key_file"] = None if given.get("simulated") else key_file(options)
    return FlightOptions(**given | more)


def key_file(options: argparse.Namespace) -> str | None:
    """Return the file of the signing key as an absolute path, None without one."""
    return _key_path("--key", options.key, KEY_VARIABLE)


def network_of(options: argparse.Namespace, before: FleetNetwork | None = None) -> FleetNetwork:
    """Create the network of the options; others are as `before`. Raises `LinkError`."""
    before = before or FleetNetwork()
    given = options.listen, options.peer, options.router
    if any(part is not None for part in given):
        listen, peers, routers = (tuple(part or ()) for part in given)
    else:
        listen, peers, routers = before.listen, before.peers, before.routers
    key = _key_path("--fleet-key", options.fleet_key, FLEET_KEY_VARIABLE)
    return FleetNetwork(listen, peers, routers, key or before.key_file)


def gives_network(options: argparse.Namespace) -> bool:
    """Return whether any option of the fleet's network is given."""
    given = (options.listen, options.peer, options.router, options.fleet_key)
    return any(part is not None for part in given)


def _key_path(option: str, given: str | None, variable: str) -> str | None:
    if given == "":
        raise LinkError(f"{option} is empty; give the file of a key")
    name = os.environ.get(variable) if given is None else given
    return str(Path(name).expanduser().absolute()) if name else None


def preflight_of(options: argparse.Namespace) -> Preflight:
    """Return the operator's options before the first take-off of real aircraft."""
    return Preflight(options.yes, options.dry_run, options.keep_fence)


def begin(options: argparse.Namespace, plan: FlightPlan, preflight: Preflight | None) -> int:
    """Fly a plan into the folder of --out; return the exit code."""
    terminal = Terminal()
    with shown_on(terminal):
        plan, mission = with_ground(plan), plan.mission
        folder = results_folder(options.out, mission.name)
        if mission.camera.calibration is not None:
            terminal.show("camera.calibration is for recorded pictures; this flight uses hfov_deg")
        try:
            with onlookers_for(options, plan, folder, terminal) as onlookers:
                into = f"{mission.name} into {folder}"  # only when page and TAK are ready
                terminal.show(f"{into}; if it is interrupted: uavmap resume {folder}")
                company = Company(onlookers=onlookers, preflight=preflight)
                summary = fly(plan, folder, company, keep_frames=options.keep_frames)
        except (NotFlownError, ExceptionGroup) as error:
            return not_flown(error)
        code = report(summary, folder, as_json=options.json, verbose=options.verbose)
        if code != AIRCRAFT_DOWN:
            draw_ground(folder, complain)
        return code


def not_flown(error: Exception) -> int:
    """Print why nothing was flown; return the exit code, or raise the error again."""
    group = error if isinstance(error, ExceptionGroup) else ExceptionGroup("", [error])
    over, others = group.split(NotFlownError)
    if over is None or others is not None:
        raise error
    for reason in leaves(over):
        complain(str(reason))
    able = all(isinstance(e, NotFlownError) and e.could_fly for e in leaves(over))
    return 0 if able else INCOMPLETE
