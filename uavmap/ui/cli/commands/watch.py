"""uavmap watch: a flight of another process, or of the past, as a page in the browser."""

from __future__ import annotations

import argparse
import contextlib
import logging
from functools import partial
from pathlib import Path
from typing import Final

from missions.errors import JournalError
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import JOURNAL
from uavmap.ui.cli.option_table import add_options
from uavmap.ui.page.feed import PORT, serve_page
from uavmap.ui.page.following import Follower

_LOG: Final = logging.getLogger("uavmap.ui.page")
EXAMPLES: Final = f"""\
  uavmap watch results/field-1                      a flight under way, or of the past
  uavmap watch results/field-1 --port 0             on any free port (default {PORT})
  uavmap watch results/field-1 --tiles area.mbtiles  over a map from a file
  uavmap watch results/field-1 --page-host 0.0.0.0  for a phone in the same network
"""
NOTES: Final = """\
The command reads the journal in the folder and changes nothing. The page has no buttons: the
process that flies receives the orders (`uavmap fly --page`). Ctrl-C ends the page.
"""
DESCRIPTION: Final = (
    "Show the mission of a results folder in a browser, live during the flight, with a time slider."
)


add_arguments: Final = partial(add_options, command="watch")


def run(options: argparse.Namespace) -> int:
    """Watch until Ctrl-C."""
    folder = Path(options.folder)
    if not folder.is_dir():
        raise JournalError(f"{folder}: no such folder; give the results folder of a flight")
    tiles = Path(options.tiles) if options.tiles else None
    follower = Follower(JournalReader(folder / JOURNAL), tiles)
    config = {
        "title": follower.title,
        "steers": False,
        "timeline": True,
        "folder": str(folder.absolute()),
        "pictures": "this flight kept no pictures: fly with --keep-frames",
    }
    with (
        contextlib.suppress(KeyboardInterrupt),
        shown_on(Terminal()),
        serve_page(config, options.port, "--port", options.page_host) as feed,
    ):
        _LOG.info("Ctrl-C ends the page")
        follower.run(feed)
    return 0
