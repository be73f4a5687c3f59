"""Options for pictures of an exploration, for every command that has one to show."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from missions.mapping.tree import Tree
from uavmap.output.film.film import Film
from uavmap.output.film.film_writers import DRAWINGS, FILMS, check_path, write_film
from uavmap.output.film.tree_picture import draw_tree
from uavmap.ui.cli.common import index_number


def add_picture_options(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add --animate and --tree; where there are `several` ROIs also --index."""
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
            help="the ROI that --animate and --tree show, counted from 0 (default 0)",
        )


def check_pictures(options: argparse.Namespace) -> None:
    """Refuse bad file names before anything is computed. Raises `OutputError`."""
    if options.animate is not None:
        check_path(options.animate, FILMS)
    if options.tree is not None:
        check_path(options.tree, DRAWINGS)


def wants_pictures(options: argparse.Namespace) -> bool:
    """Whether any picture was asked for."""
    return bool(options.animate or options.tree)


def write_pictures(
    options: argparse.Namespace, film: Film, tree: Tree | None, say: Callable[[str], None]
) -> None:
    """Write what was asked for; `say` reports progress and files. Raises `OutputError`."""
    if options.animate is not None:
        write_film(film, options.animate, say)
        say(f"animation in {options.animate}")
    if options.tree is not None and tree is not None:
        draw_tree(tree, options.tree, title=film.title)
        say(f"tree in {options.tree}")
