"""uavmap animate: an animation of a flight, and a picture of its exploration tree."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final

from missions.errors import OutputError
from missions.mapping.tree import Tree
from uavmap.base.terminal import Terminal
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.output.facts.score import true_roi
from uavmap.output.film.film import Film, film_of_flight, title_of
from uavmap.output.film.film_writers import DRAWINGS, FILMS, check_path, write_film
from uavmap.output.film.rerun_recording import SUFFIX, sdk, write_recording
from uavmap.output.film.tree_picture import draw_tree
from uavmap.ui.cli.common import index_number
from uavmap.ui.cli.option_table import add_options

ANIMATION: Final = "flight.gif"
TREE: Final = "tree.png"

EXAMPLES: Final = """\
  uavmap animate results/runway-1                       flight.gif and tree.png in that folder
  uavmap animate results/spill-1 --animate spill.mp4    spill.mp4 in the current folder
  uavmap animate results/spill-1 --animate spill.mp4 -o results/spill-1
  uavmap animate results/spill-1 --tree tree.svg
  uavmap animate results/spill-1 --rerun spill.rrd      for the Rerun viewer: rerun spill.rrd
"""
NOTES: Final = """\
The animation of any flight takes at most 20 seconds. If the region drifts, the tracks are relative
to the region.
"""
DESCRIPTION: Final = "Make an animation and a picture of the tree from the journal of a mission."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_options(parser, "animate")
    add_picture_options(parser)
    parser.add_argument(
        "-o",
        "--out",
        metavar="FOLDER",
        type=Path,
        help="the folder for files that you name without a folder (default: the current one; DIR "
        "for flight.gif and tree.png)",
    )
    parser.add_argument(
        "--rerun",
        metavar="FILE.rrd",
        type=Path,
        help="write cells, tree, vehicles, batteries and kept frames on one timeline, for the "
        "Rerun viewer (needs the extra rerun)",
    )


def _place(options: argparse.Namespace) -> None:
    """Put files that are named without a folder into --out. Raises `OutputError`."""
    if not options.out.is_dir():
        raise OutputError(f"--out {options.out}: no such folder; make it first")
    for option in ("animate", "tree", "rerun"):
        path = getattr(options, option)
        if path is not None and path.parent == Path():
            setattr(options, option, options.out / path)


def run(options: argparse.Namespace) -> int:
    """Write animation, tree and recording."""
    folder, show = Path(options.folder), Terminal().show
    needs_tree = options.tree is not None
    if options.out is not None:
        _place(options)
    if options.rerun is not None:
        check_path(options.rerun, (SUFFIX,))
        sdk()
    elif not wants_pictures(options):
        into = options.out or folder
        options.animate, options.tree = into / ANIMATION, into / TREE
    journal = JournalReader(folder / JOURNAL)
    check_pictures(options)
    plan, recorded = FlightPlan.read(journal), "replay" in journal.meta
    setting = plan.known_setting()
    events = list(journal.events())
    mission, truth = setting.mission, None
    if plan.simulated and not recorded and mission.sim.roi:
        truth = true_roi(mission, setting.grid)
    title = title_of(mission, recorded=recorded)
    film, state = film_of_flight(setting, events, title, truth=truth, recorded=recorded)
    if not film.changes:
        raise OutputError(f"{folder}: no picture was judged; there is nothing to animate")
    if state.tree is None and options.tree is not None:
        if needs_tree:
            raise OutputError(f"{folder}: the region was not found; there is no tree to draw")
        show("the region was not found; there is no tree to draw")
        options.tree = None
    write_pictures(options, film, state.tree, show)
    if options.rerun is not None:
        write_recording(options.rerun, film, events, setting.grid, folder)
        show(f"recording in {options.rerun}")
    return 0


# --- pictures of an exploration, also for `uavmap simulate` -------------------------------------
def add_picture_options(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add --animate and --tree; with `several` ROIs also --index."""
    parser.add_argument(
        "--animate",
        metavar="FILE",
        type=Path,
        help="write the exploration as an animation, .gif or .mp4",
    )
    parser.add_argument(
        "--tree",
        metavar="FILE",
        type=Path,
        help="write the exploration tree with its backbone, ribs and states, .png or .svg",
    )
    if several:
        parser.add_argument(
            "--index",
            metavar="N",
            type=index_number,
            default=0,
            help="the number of the ROI for --animate and --tree, counted from 0 (default 0)",
        )


def check_pictures(options: argparse.Namespace) -> None:
    """Refuse bad file names before the computation. Raises `OutputError`."""
    if options.animate is not None:
        check_path(options.animate, FILMS)
    if options.tree is not None:
        check_path(options.tree, DRAWINGS)


def wants_pictures(options: argparse.Namespace) -> bool:
    """Return whether a picture is to be written."""
    return bool(options.animate or options.tree)


def write_pictures(
    options: argparse.Namespace, film: Film, tree: Tree | None, show: Callable[[str], None]
) -> None:
    """Write the chosen pictures; `show` reports progress and files. Raises `OutputError`."""
    if options.animate is not None:
        write_film(film, options.animate, show)
        show(f"animation in {options.animate}")
    if options.tree is not None and tree is not None:
        draw_tree(tree, options.tree, title=film.title)
        show(f"tree in {options.tree}")
