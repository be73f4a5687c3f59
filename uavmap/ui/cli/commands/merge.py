"""uavmap merge: one map of the journals of a fleet, or of several flights over the same ground."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from uavmap.base.terminal import Terminal
from uavmap.output.merging import merged_results
from uavmap.ui.cli.common import EXIT_CODES, report
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = f"""\
examples:
  uavmap merge results/bay-1 results/bay-2 results/bay-3 --out results/bay
  uavmap merge monday tuesday --out both --json
  scp -r drone-2:results/bay-2 . && uavmap merge bay-1 bay-2 --out bay

The folders are those of `uavmap onboard`, one a vehicle, or of several flights over the same grid,
in any order. Of a vehicle whose folder is lost, the frames count that others have heard of. The
folders are only read, also while a flight is still under way in them.

{EXIT_CODES}"""
DESCRIPTION: Final = "Make one map of the journals of a fleet, or of several flights."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument(
        "folders", metavar="DIR", nargs="+", help="folders of results, each with its journal"
    )
    parser.add_argument(
        "--out", metavar="DIR", required=True, help="a new folder for the results of all"
    )
    add_options(parser, "merge")


def run(options: argparse.Namespace) -> int:
    """Merge."""
    out = Path(options.out)
    summary = merged_results([Path(folder) for folder in options.folders], out, Terminal().show)
    return report(summary, out, as_json=options.json, verbose=options.verbose, goes_on=False)
