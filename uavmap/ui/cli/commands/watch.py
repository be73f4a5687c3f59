"""uavmap watch: a flight of another program, or one of the past, as a page in the browser."""

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
from uavmap.ui.page.feed import PORT, opened
from uavmap.ui.page.following import Follower

_LOG: Final = logging.getLogger("uavmap.ui.page")
EXAMPLES: Final = f"""\
examples:
  uavmap watch results/field-1                      a flight under way, or one of the past
  uavmap watch results/field-1 --port 0             on any port that is free (default {PORT})
  uavmap watch results/field-1 --tiles area.mbtiles  over a map from a file
  uavmap watch results/field-1 --page-host 0.0.0.0  for a phone in the same network

It reads the journal in the folder and changes nothing; a flight under way does not notice it. There
are no buttons: the program that flies takes the orders (`uavmap fly --page`). Ctrl-C ends it.
"""
DESCRIPTION: Final = (
    "Show the mission of a results folder in a browser: live while it is flown, with a time slider."
)


add_arguments: Final = partial(add_options, command="watch")


def run(options: argparse.Namespace) -> int:
    """Watch until Ctrl-C."""
    folder = Path(options.folder)
    if not folder.is_dir():
        raise JournalError(f"{folder}: there is no such folder; name the results of a flight")
    tiles = Path(options.tiles) if options.tiles else None
    follower = Follower(JournalReader(folder / JOURNAL), tiles)
    config = {
        "title": follower.title,
        "steers": False,
        "timeline": True,
        "folder": str(folder.absolute()),
        "pictures": "no picture is kept: fly with --keep-frames",
    }
    with (
        contextlib.suppress(KeyboardInterrupt),
        shown_on(Terminal()),
        opened(config, options.port, "--port", options.page_host) as feed,
    ):
        _LOG.info("Ctrl-C ends it")
        follower.run(feed)
    return 0
