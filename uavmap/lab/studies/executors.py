"""Trials one after the other, spread over processes, or over a Dask cluster."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from importlib import import_module
from multiprocessing import active_children, get_context
from typing import Any, Final, TextIO

from uavmap.base.extras import dask_client

SHARES: Final = 16
"""Batches a worker: few enough to cost little, many enough to end together."""
MOST_JOBS: Final = 20
"""Maximum of a batch: progress is shown by the batch."""
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
    """Compute `[trial(job) for job in jobs]` anywhere.

    Args:
        trial: A pure function that can be pickled.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler, used instead of processes.
        progress: Shows the number of finished jobs.

    Raises `StudyError` where the scheduler does not answer, or Dask is not installed.
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
    size = min(max(1, len(jobs) // (workers * SHARES)), MOST_JOBS)
    return [(i, list(jobs[i : i + size])) for i in range(0, len(jobs), size)]


def _run(trial: Trial, batch: Batch) -> Batch:
    first, jobs = batch
    return first, [trial(job) for job in jobs]


def _ignore_interrupts() -> None:
    """Ctrl-C reaches the whole process group; the parent alone answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _processes(trial: Trial, jobs: Sequence[Any], workers: int) -> Generator[Batch]:
    others = set(active_children())
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _ignore_interrupts)
    try:
        waiting = [pool.submit(_run, trial, batch) for batch in _batches(jobs, workers)]
        for future in as_completed(waiting):
            yield future.result()
    except BaseException:  # nobody waits for trials that are not wanted any more
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
