"""uavmap resume: go on with an interrupted mission."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from uavmap.cli.common import report
from uavmap.fly.flight import resume
from uavmap.fly.progress import Terminal

_EXAMPLES = """\
examples:
  uavmap resume results/runway-1
  uavmap resume results/field-3 --connect udpin://0.0.0.0:14560

A simulated flight is repeated up to its last event, each event checked against the journal, and
goes on from there. A real flight goes on from what the journal knows, with the aircraft wherever
they are.
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "resume",
        help="go on with an interrupted mission",
        description="Go on with the mission of a results folder from its last committed event.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", metavar="DIR", help="the results folder of the mission")
    parser.add_argument(
        "--connect",
        metavar="URL",
        action="append",
        default=[],
        help="where a vehicle is reached now, if that has changed",
    )
    parser.add_argument(
        "--from-home",
        action="store_true",
        help="simulation: put the aircraft at home with full batteries instead of where they were",
    )
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Resume."""
    folder = Path(options.folder)
    summary = resume(folder, Terminal(), urls=tuple(options.connect), from_home=options.from_home)
    return report(summary, folder, as_json=options.json)
