"""uavmap study: the measurements of the papers, repeated."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import active_children, get_context
from typing import Any, Final, TextIO

from missions.errors import StudyError
from uavmap.base.extras import dask_client, install_command
from uavmap.journal.results_folder import make_folder, results_folder
from uavmap.lab.studies import STUDIES
from uavmap.lab.studies.study_model import Page
from uavmap.ui.cli.common import refuse_existing, seed_number, worker_count

SHOWN_ROWS: Final = 20
"""Maximum length of a printed table; longer ones are only written."""

EXAMPLES: Final = """\
  uavmap study greedy-table-1 --quick               a few seconds' worth of it
  uavmap study roi-figure-7 --workers 2             over the processors of this machine
  uavmap study strategies --scheduler tcp://10.0.0.5:8786
"""
NOTES: Final = """\
Each writes NAME.csv, NAME.png and NAME.md. The same seed gives the same files on any computer.
Needs the extra study; for --scheduler also the extra cluster, and uavmap on every worker.
"""

_NAMES = "\n".join(f"  {study.name:16}{study.about}" for study in STUDIES.values())
DESCRIPTION: Final = f"Repeat a study and compare its numbers with those of the paper:\n\n{_NAMES}"


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
    refuse_existing(folder, Page.files(study.name))
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


SHARES: Final = 16
"""Number of batches for each worker: few cost little, many end together."""
MAX_JOBS: Final = 20
"""Maximum number of jobs in a batch: progress is shown by the batch."""
PATIENCE_S: Final = 2.0
LINE_S: Final = 3.0
REDRAW_S: Final = 0.2
ANSWER_S: Final = 10.0

Trial = Callable[[Any], Any]
Batch = tuple[int, list[Any]]
"""The number of the first job, and jobs or results from there on."""


def spread(
    trial: Trial,
    jobs: Sequence[Any],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> list[Any]:
    """Compute `[trial(job) for job in jobs]` on processes or a cluster.

    Args:
        trial: A pure function that can be pickled.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler, used instead of processes.
        progress: Shows the number of finished jobs.

    Raises `StudyError` if the scheduler does not answer, or Dask is not installed.
    """
    if scheduler is not None:
        found = _dask(trial, jobs, scheduler)
    elif workers > 1:
        found = _processes(trial, jobs, workers)
    else:
        found = ((i, [trial(job)]) for i, job in enumerate(jobs))
    results: list[Any] = [None] * len(jobs)
    done = 0
    with closing(found):
        for first, some in found:
            results[first : first + len(some)] = some
            done += len(some)
            if progress is not None:
                progress.update(done)
    return results


def _batches(jobs: Sequence[Any], workers: int) -> list[Batch]:
    size = min(max(1, len(jobs) // (workers * SHARES)), MAX_JOBS)
    return [(i, list(jobs[i : i + size])) for i in range(0, len(jobs), size)]


def _run(trial: Trial, batch: Batch) -> Batch:
    first, jobs = batch
    return first, [trial(job) for job in jobs]


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C, which reaches the whole process group: the parent alone handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _processes(trial: Trial, jobs: Sequence[Any], workers: int) -> Generator[Batch]:
    others = set(active_children())
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _ignore_interrupts)
    try:
        waiting = [pool.submit(_run, trial, batch) for batch in _batches(jobs, workers)]
        for future in as_completed(waiting):
            yield future.result()
    except BaseException:  # do not wait for cancelled trials
        for process in set(active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _dask(trial: Trial, jobs: Sequence[Any], address: str) -> Generator[Batch]:
    client = dask_client(address, ANSWER_S, import_module)
    distributed: Any = import_module("distributed")
    with client:
        threads = max(1, sum(client.nthreads().values()))
        waiting = client.map(_run, [trial] * len(jobs), _batches(jobs, threads), pure=False)
        try:
            for future in distributed.as_completed(waiting, loop=client.loop):
                yield future.result()
        finally:
            client.cancel(waiting)


class Progress:
    """The number of finished trials, on standard error, after a while."""

    def __init__(self, name: str, jobs: int, stream: TextIO | None = None) -> None:
        self._name, self._jobs = name, jobs
        self._stream = stream or sys.stderr
        self._begin_s = self._said_s = time.monotonic()

    def update(self, done: int) -> None:
        """Show the number of finished jobs."""
        now_s = time.monotonic()
        redraws = self._stream.isatty()
        if now_s - self._begin_s < PATIENCE_S:
            return
        if now_s - self._said_s < (REDRAW_S if redraws else LINE_S):
            return
        self._said_s = now_s
        text = f"{self._name}: {done} of {self._jobs} trials"
        self._stream.write(f"\r{text}\033[K" if redraws else text + "\n")
        self._stream.flush()

    def end(self) -> None:
        """Clear the line."""
        if self._stream.isatty():
            self._stream.write("\r\033[K")
            self._stream.flush()
