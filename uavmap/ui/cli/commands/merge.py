"""uavmap merge: one map from the journals of a fleet, or of several flights over one ground."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from uavmap.base.terminal import Terminal
from uavmap.output.merging import merged_results
from uavmap.ui.cli.common import EXIT_CODES, report
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap merge results/bay-1 results/bay-2 results/bay-3 --out results/bay
  uavmap merge monday tuesday --out both --json
  scp -r drone-2:results/bay-2 . && uavmap merge bay-1 bay-2 --out bay
"""
NOTES: Final = f"""\
Give the results folders of `uavmap onboard`, one for each vehicle, or of several flights over the
same grid, in any order. If the folder of a vehicle is lost, the frames that others received from it
still count. The folders are only read, also while a flight writes to them.

{EXIT_CODES}"""
DESCRIPTION: Final = "Make one map from the journals of a fleet, or of several flights."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument(
        "folders", metavar="DIR", nargs="+", help="results folders, each with its journal"
    )
    parser.add_argument(
        "--out", metavar="DIR", required=True, help="a new folder for the merged results"
    )
    add_options(parser, "merge")


def run(options: argparse.Namespace) -> int:
    """Merge the journals."""
    out = Path(options.out)
    summary = merged_results([Path(folder) for folder in options.folders], out, Terminal().show)
    return report(summary, out, as_json=options.json, verbose=options.verbose, can_resume=False)
