"""uavmap report: the report of a flight, made anew from its folder."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from missions.errors import OutputError
from uavmap.base.terminal import Terminal
from uavmap.output.documents import REPORT, write_report
from uavmap.output.results import flown_of
from uavmap.ui.cli.commands.export import report_incomplete
from uavmap.ui.cli.common import print_summary
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
examples:
  uavmap report results/field-1                     writes results/field-1/report.html anew
  uavmap report results/field-1 --out field.html    the same elsewhere

Every flight and every replay has a report. This makes it from the folder alone, also of a flight
that was interrupted. The page loads nothing and runs nothing: it can be sent, and a browser prints
it, or saves it as PDF.
"""
DESCRIPTION: Final = (
    "Write the report of a flight or a replay: map, area, certificate, timeline, "
    "faults and settings on one page."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_options(parser, "report")
    parser.add_argument(
        "--out", metavar="FILE.html", type=Path, help="the page (default: report.html in DIR)"
    )


def run(options: argparse.Namespace) -> int:
    """Write it. Raises `UavmapError`."""
    folder, out, say = Path(options.folder), options.out, Terminal().show
    if out is not None and out.exists():
        raise OutputError(f"--out {out}: is there already; choose another name")
    flown = flown_of(folder)
    report_incomplete(flown, say)
    write_report(flown, out)
    print_summary(flown.values, folder, as_json=options.json, verbose=options.verbose)
    say(f"{out or folder / REPORT}")
    return 0
