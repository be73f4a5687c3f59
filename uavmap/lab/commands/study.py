"""uavmap study: what the papers measured, measured again."""

from __future__ import annotations

import argparse
import json
from importlib.util import find_spec
from typing import Final

from missions.errors import StudyError
from uavmap.base.extras import install_command
from uavmap.journal.results_folder import make_folder, results_folder
from uavmap.lab.studies import STUDIES
from uavmap.lab.studies.executors import Progress, spread
from uavmap.lab.studies.study_model import Page
from uavmap.ui.cli.common import overwrite_nothing, seed_number, worker_count

SHOWN_ROWS: Final = 20
"""Longer tables are not printed, only written."""

EXAMPLES: Final = """\
examples:
  uavmap study greedy-table-1 --quick               a few seconds' worth of it
  uavmap study roi-figure-7 --workers 2             over the processors of this machine
  uavmap study strategies --scheduler tcp://10.0.0.5:8786

Each writes NAME.csv, NAME.png and NAME.md. The same seed gives the same files, wherever the trials
are computed. Needs the extra study; for --scheduler also the extra cluster, and uavmap on every
worker.
"""

_NAMES = "\n".join(f"  {study.name:16}{study.about}" for study in STUDIES.values())
DESCRIPTION: Final = f"Repeat a study and set the paper's numbers beside ours:\n{_NAMES}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument(
        "name", metavar="NAME", choices=STUDIES, help=f"one of: {', '.join(STUDIES)}"
    )
    parser.add_argument("--quick", action="store_true", help="few and small trials")
    parser.add_argument("--out", metavar="DIR", help="folder for the files (default: a new one)")
    parser.add_argument("--seed", metavar="S", type=seed_number, default=1, help="default 1")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", metavar="N", type=worker_count, default=1, help="processes (default 1)"
    )
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")


def run(options: argparse.Namespace) -> int:
    """Run a study."""
    study = STUDIES[options.name]
    missing = [name for name in ("matplotlib", "numba") if find_spec(name) is None]
    if missing:
        raise StudyError(f"studies need {' and '.join(missing)}: {install_command('study')}")
    folder = results_folder(options.out, f"study-{study.name}")
    overwrite_nothing(folder, Page.files(study.name))
    make_folder(folder)
    jobs = study.jobs(options.quick, options.seed)
    progress = Progress(study.name, len(jobs))
    try:
        results = spread(
            study.trial,
            jobs,
            workers=options.workers,
            scheduler=options.scheduler,
            progress=progress,
        )
    finally:
        progress.end()
    page = study.conclude(results)
    files = page.write(study.name, folder)
    if options.json:
        rows = [dict(zip(page.table.columns, row, strict=True)) for row in page.table.rows]
        report = {"study": study.name, "seed": options.seed, "out": str(folder), "rows": rows}
        print(json.dumps(report, indent=2))
    else:
        print(f"{page.title}\n\n{page.text.strip()}\n")
        if len(page.table.rows) <= SHOWN_ROWS:
            print(f"{page.table.markdown()}\n")
        print("\n".join(map(str, files)))
    return 0
