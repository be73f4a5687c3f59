"""uavmap report: write the report of a flight again from its folder."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from missions.errors import OutputError
from uavmap.base.extras import install_command
from uavmap.base.terminal import Terminal
from uavmap.output.documents import REPORT, REPORT_PDF, prints_pdf, write_pdf, write_report
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.results import flown_of
from uavmap.ui.cli.commands.export import report_incomplete
from uavmap.ui.cli.common import print_summary
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap report results/field-1                     writes report.html and report.pdf there again
  uavmap report results/field-1 --out field.html    the page in another place
  uavmap report results/field-1 --out field.pdf     the PDF in another place
"""
NOTES: Final = """\
Each flight and each replay ends with a report. This command writes it from the folder, also for an
interrupted flight. The page fits a phone and has no external files and no scripts: you can send it.
The PDF has two pages A4, to print and to sign, and needs the extra `pdf`.
"""
DESCRIPTION: Final = (
    "Write the report of a flight or a replay as a page for a screen and as two pages A4. It has "
    "gaps, area, map, times, aircraft and faults."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_options(parser, "report")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help="one file, FILE.pdf or FILE.html (default: report.html and report.pdf in DIR)",
    )


def run(options: argparse.Namespace) -> int:
    """Write the report. Raises `UavmapError`."""
    folder, out, show = Path(options.folder), options.out, Terminal().show
    if out is not None and out.exists():
        raise OutputError(f"--out {out}: already exists; choose another name")
    flown = flown_of(folder)
    report_incomplete(flown, show)
    written = list(_write(flown, out))
    print_summary(flown.values, folder, as_json=options.json, verbose=options.verbose)
    for line in written:
        show(line)
    return 0


def _write(flown: FlownMission, out: Path | None) -> Iterator[str]:
    """Write the chosen files, and yield a line about each."""
    if out is None or out.suffix.lower() != ".pdf":
        write_report(flown, out)
        yield f"{out or flown.folder / REPORT}"
    if out is None and not prints_pdf():
        yield f"no {REPORT_PDF}: it needs reportlab: {install_command('pdf')}"
    elif out is None or out.suffix.lower() == ".pdf":
        write_pdf(flown, out)
        yield f"{out or flown.folder / REPORT_PDF}"
