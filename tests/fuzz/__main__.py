"""Fuzz the doors of the program.

    python -m tests.fuzz --minutes 10 --seed 1 [TARGET ...]

Each target gets a process of its own, and the stated minutes of CPU time. With atheris
(`pip install atheris`, on Linux) inputs are guided by the coverage of the product. An input that
fails is kept in `tests/fuzz/kept`, where a test finds it. `--record` writes runs into the record of
`docs/reliability.md`.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

NAMES = (
    "mavlink", "pictures", "records", "missions", "areas", "journals", "fleet", "process", "page",
    "models", "maps",
)  # fmt: skip
INSTRUMENTED = ("missions", "vision", "uavmap", "shapefile", "pmtiles")


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.fuzz")
    parser.add_argument("target", nargs="*", choices=NAMES, default=NAMES)
    parser.add_argument("--minutes", type=float, default=1.0, help="CPU minutes of each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", action="store_true")
    return parser.parse_args()


def separately(chosen: argparse.Namespace) -> int:
    """Run each target in a process; return how many of them found a failure."""
    line = ["--minutes", str(chosen.minutes), "--seed", str(chosen.seed)]
    line += ["--record"] if chosen.record else []
    start = [sys.executable, "-m", "tests.fuzz", *line]
    return sum(subprocess.run([*start, name], check=False).returncode != 0 for name in NAMES
               if name in chosen.target)  # fmt: skip


def alone(chosen: argparse.Namespace) -> int:
    """Run a target in this process; return 1 if it found a failure."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"  # numba compiles no code with counters in it
    warnings.simplefilter("error")
    is_guided = importlib.util.find_spec("atheris") is not None
    with contextlib.ExitStack() as importing:
        if is_guided:
            import atheris  # noqa: PLC0415

            importing.enter_context(atheris.instrument_imports(list(INSTRUMENTED)))
        from tests.fuzz import engine, record, targets  # noqa: PLC0415
    target = targets.TARGETS[chosen.target[0]]

    def end(result: engine.Result) -> int:
        edges = "" if result.edges is None else f", {result.edges} branches"
        print(f"{target.name}: {result.executions} inputs{edges}, {len(result.found)} failures")
        for failure, data in result.found.items():
            print(f"  {failure}: {engine.keep(target, failure, data)}")
        if chosen.record:
            record.keep(record.row(target.name, chosen.seed, chosen.minutes, result))
        sys.stdout.flush()
        return int(bool(result.found))

    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        folder = Path(name)
        examples, seconds = target.examples(folder), 60.0 * chosen.minutes
        if is_guided:
            engine.guided(target, examples, folder, chosen.seed, seconds, end)
        return end(engine.plain(target, examples, folder, chosen.seed, sys.maxsize, seconds))


if __name__ == "__main__":
    chosen = options()
    sys.exit(alone(chosen) if len(chosen.target) == 1 else separately(chosen))
