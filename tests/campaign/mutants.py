"""Are faults found? `python -m tests.campaign.mutants [--only WORDS] [--clean]`.

Each fault of `mutants.toml` is sown into a copy of the program. Flights of the campaign with the
referee, or tests, look for it until the first finding. `mutants.json` keeps what found each;
`python -m tests.reference_pages` makes a page of it. Exit 1 if a fault is not found.

`--only` sows those faults whose part and name hold these words; `--clean` first flies all seeds
without a fault, which must find nothing.
"""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[2]
TABLE: Final = Path(__file__).with_name("mutants.toml")
RESULT: Final = Path(__file__).with_name("mutants.json")
COPIED: Final = ("missions", "vision", "sitl", "uavmap", "tests", "pyproject.toml")
LIMIT_S: Final = 900.0
"""Longest time that flights, or tests, may look for a fault."""
PRELOADED: Final = (
    "cv2", "numba", "pydantic", "pymavlink.dialects.v20.ardupilotmega", "pyproj",
    "scipy.sparse", "shapely",
)  # fmt: skip
"""Packages of others, which are imported once for all faults."""

Found = list[str]
"""By a flight or a test, which, the promise or the test, and the text; empty for nothing."""


@dataclass(frozen=True, slots=True)
class Flights:
    """Seeds of one world of the campaign."""

    seeds: Sequence[int]
    world: str = "reducer"
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Mutant:
    """A seeded fault, and what looks for it: flights first, then tests."""

    part: str
    fault: str
    file: str
    before: str
    after: str
    flights: str = ""
    tests: Sequence[str] = ()

    @property
    def name(self) -> str:
        return f"{self.part}: {self.fault}"

    def sow(self, root: Path) -> None:
        """Change the copy of the program. Raises `ValueError` unless the text is there once."""
        text = (root / self.file).read_text("utf-8")
        if text.count(self.before) != 1:
            raise ValueError(f"{self.file} has {text.count(self.before)} times {self.before!r}")
        (root / self.file).write_text(text.replace(self.before, self.after), "utf-8")


def table(path: Path = TABLE) -> tuple[list[Mutant], dict[str, Flights]]:
    """Return the faults, and the flights by their names."""
    read = tomllib.loads(path.read_text("utf-8"))
    flights = {name: Flights(**values) for name, values in read["flights"].items()}
    return [Mutant(**row) for row in read["mutant"]], flights


def copy_program(root: Path) -> None:
    """Make a copy of the program, with what was compiled; all else in it is a link."""
    for path in ROOT.iterdir():
        if path.name not in COPIED:
            (root / path.name).symlink_to(path)
        elif path.is_dir():
            shutil.copytree(path, root / path.name)
        else:
            shutil.copy2(path, root / path.name)


def fly(world: str, seeds: Sequence[int], options: Mapping[str, Any]) -> Found:
    """Fly seeds until the referee finds something."""
    module = importlib.import_module("tests.campaign." + {"sitl": "simulated"}.get(world, world))
    for seed in seeds:
        found = module.fly(seed, **options).found
        if found:
            return ["flight", f"{world} {seed}", *found[0]]
    return []


def test(*files: str) -> Found:
    """Run tests until the first fails."""

    class First:
        found: Found = []  # noqa: RUF012 - of one run

        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.failed and not self.found:
                file, _, name = report.nodeid.partition("::")
                self.found = ["test", file, name, report.longreprtext.strip().splitlines()[-1]]

    first = First()
    code = pytest.main(["-x", "-q", *files], plugins=[first])
    if code and not first.found:
        raise ValueError(f"tests without a judgement: {code!r}")
    return first.found


def _inside(root: Path, out: Path, work: Callable[..., Found], given: Sequence[Any]) -> None:
    """Do something with the program below `root`, in a process of its own."""
    os.chdir(root)
    sys.path.insert(0, str(root))
    sys.dont_write_bytecode = True
    for name in [name for name in sys.modules if name.partition(".")[0] in COPIED]:
        del sys.modules[name]
    with (root / "printed.txt").open("w") as printed:
        os.dup2(printed.fileno(), 1)
        os.dup2(printed.fileno(), 2)
        out.write_text(json.dumps(work(*given)), "utf-8")


def apart(root: Path, work: Callable[..., Found], *given: Any) -> Found:
    """Return what some work finds in a program. Raises `ValueError` if it does not end well."""
    out = root / "found.json"
    child = multiprocessing.get_context("fork").Process(
        target=_inside, args=(root, out, work, given)
    )
    child.start()
    child.join(LIMIT_S)
    if child.is_alive():
        child.kill()
        child.join()
    if child.exitcode:
        raise ValueError((root / "printed.txt").read_text("utf-8")[-1000:])
    found: Found = json.loads(out.read_text("utf-8"))
    return found


def flown(root: Path, flights: Flights) -> Found:
    return apart(root, fly, flights.world, flights.seeds, flights.options)


def found_by(mutant: Mutant, flights: Mapping[str, Flights]) -> Found:
    """Return what finds a fault first."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        copy_program(root)
        mutant.sow(root)
        found = flown(root, flights[mutant.flights]) if mutant.flights else []
        return found or (apart(root, test, *mutant.tests) if mutant.tests else [])


def unclean(flights: Mapping[str, Flights]) -> list[str]:
    """Return what the referee finds in the flights of the program as it is."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        copy_program(root)
        found = [flown(root, each) for each in flights.values()]
    return [": ".join(each[1:]) for each in found if each]


def results(path: Path = RESULT) -> dict[str, Found]:
    """Return what found each fault, by its name."""
    read: dict[str, Found] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return read


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="words of the part or the name")
    parser.add_argument("--clean", action="store_true", help="first fly without a fault")
    options = parser.parse_args()
    for package in PRELOADED:
        importlib.import_module(package)
    mutants, flights = table()
    wrong = unclean(flights) if options.clean else []
    print(*[f"without a fault: {line}" for line in wrong], sep="\n", end="", flush=True)
    known, missed, chosen = results(), 0, [m for m in mutants if options.only in m.name]
    for mutant in chosen:
        found = found_by(mutant, flights)
        known[mutant.name] = found
        missed += not found
        text = ": ".join(found[1:]) if found else ""
        print(f"{'found' if found else 'NOT FOUND':10s}{mutant.name}: {text}"[:300], flush=True)
        kept = {m.name: known[m.name] for m in mutants if m.name in known}
        RESULT.write_text(json.dumps(kept, indent=1) + "\n", "utf-8")
    print(f"{len(chosen) - missed} of {len(chosen)} faults are found")
    return 1 if missed or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
