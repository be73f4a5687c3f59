"""Write `docs/reliability.md`: what was flown, what was injected, what was found.

    python -m tests.reliability

The page takes the records that the commands keep: campaigns (`tests.campaign --record`), flights of
real autopilots (`tests.real`), seeded faults, branch coverage and failures that were found.
"""

from __future__ import annotations

import json
import textwrap
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from scipy.stats import beta

from tests.campaign import mutants
from tests.campaign.outcome import FORBIDDEN
from tests.campaign.record import Run, kept
from tests.fuzz import engine
from tests.fuzz import record as fuzz
from tests.real import figures

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "reliability.md"
FAILURES: Final = ROOT / "tests" / "campaign" / "failures.toml"
COVERAGE: Final = ROOT / "tests" / "coverage.json"
CONFIDENCE: Final = 0.95
WORLDS: Final = ("reducer", "machine", "sitl", "fleet")
PROMISES: Final = {
    "air": "no vehicle is in the air at the end",
    "alone": "one part is responsible for each vehicle in the air; nothing is sent to a pilot's",
    "taken": "a mode that a pilot chose is never changed",
    "breach": "no order leads out of the fence or into a hole",
    "far": "a vehicle is never carried more than 150 m out",
    "near": "vehicles keep their separation in 3D",
    "fell": "a vehicle turns back while it has energy",
    "reserve": "a vehicle lands with its reserve",
    "lie": "what the program reports is true, and nothing confirmed is lost",
    "unrep": "a crash, and a landing away from the pad, is reported",
    "owner": "settings of the owner are given back",
    "end": "a flight ends",
    "tb": "the program has no defect that stops it",
}
"""The promise behind each forbidden column of the campaign's table."""


DOORS: Final = {
    "mavlink": "bytes of a link",
    "pictures": "photographs and their tags",
    "records": "subtitles, telemetry logs, geotag files, calibrations",
    "missions": "mission files",
    "areas": "drawings, archives with them, zones, prior places",
    "journals": "lines of a journal",
    "fleet": "datagrams of a member with the key, and without it",
    "process": "messages between mission and aircraft",
    "page": "requests and WebSocket connections, and the page's orders",
    "models": "detectors, their tables, ONNX models",
    "maps": "MBTiles and PMTiles",
}
"""The input of each target of `tests.fuzz`."""


def upper_bound(violations: int, flights: int) -> float:
    """Return the upper bound of a rate at 95 % (Clopper and Pearson); 0 in N gives about 3/N."""
    if violations >= flights:
        return 1.0
    return float(beta.ppf(CONFIDENCE, violations + 1, flights - violations))


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(str(c).replace('|', '/') for c in row)} |" for row in lines)


def _by_world(runs: Sequence[Run]) -> dict[str, list[Run]]:
    found = defaultdict[str, list[Run]](list)
    for run in runs:
        found[run.world].append(run)
    return {world: found[world] for world in WORLDS if world in found}


def _total(parts: Iterable[Mapping[str, int]]) -> Counter[str]:
    return sum((Counter(part) for part in parts), Counter[str]())


def flown_text(runs: Sequence[Run]) -> str:
    """Return the table of campaigns."""
    rows = [
        (
            run.world, f"`{run.options}`" if run.options else "", f"`{run.commit}`",
            f"{run.seed} +", f"{run.flights:,}", len(run.found),
        )
        for each in _by_world(runs).values() for run in each
    ]  # fmt: skip
    return table(("world", "options", "commit", "seeds from", "flights", "faults"), rows)


def injected(runs: Sequence[Run]) -> str:
    """Return how many flights had each trouble, by world."""
    found = {world: _total(run.kinds for run in each) for world, each in _by_world(runs).items()}
    worlds = {world: counts for world, counts in found.items() if counts}
    kinds = sorted({kind for counts in worlds.values() for kind in counts} - {"pairs"})
    rows = [(kind, *(counts[kind] or "" for counts in worlds.values())) for kind in kinds]
    last = ("two of them", *(counts["pairs"] for counts in worlds.values()))
    return table(("trouble", *worlds), [*rows, last])


def outcomes(runs: Sequence[Run]) -> str:
    """Return how the flights ended, by world."""
    rows = []
    for world, each in _by_world(runs).items():
        columns = _total(run.columns for run in each)
        if not columns:  # a run of the state machine ends at its first fault
            continue
        flights = sum(run.flights for run in each)
        rows.append((world, f"{flights:,}", *(columns[c] for c in ("ok", "inc", "away", "crash"))))
    header = ("world", "flights", "complete", "reported as incomplete", "not all at home", "crash")
    return table(header, rows)


def promises(runs: Sequence[Run]) -> str:
    """Return violations of each promise with the upper bound of their rate, by world."""
    worlds = _by_world(runs)
    rows = []
    for column, promise in PROMISES.items():
        cells = []
        for each in worlds.values():
            flights = sum(run.flights for run in each)
            count = _violations(each, column)
            cells.append(f"{count} (< {upper_bound(count, flights):.1%})")
        rows.append((promise, *cells))
    return table(("promise", *worlds), rows)


def _violations(runs: Iterable[Run], column: str) -> int:
    """Return the number of flights in which the promise of a column was broken."""
    return sum(
        len({plan for plan, kind, _ in run.found if FORBIDDEN[kind] == column}) for run in runs
    )


def forgiven(runs: Sequence[Run]) -> str:
    """Return how often each forgiveness was used, by world."""
    worlds = {w: _total(run.forgiven for run in each) for w, each in _by_world(runs).items()}
    names = sorted({name for counts in worlds.values() for name in counts})
    rows = [(name, *(counts[name] or "" for counts in worlds.values())) for name in names]
    return table(("forgiveness", *worlds), rows)


def real() -> str:
    """Return the flights of real autopilots, by version."""
    rows = defaultdict[tuple[str, str], list[figures.Row]](list)
    for row in figures.kept():
        rows[figures.NAMES[row.autopilot], row.version].append(row)
    return table(
        ("autopilot", "version", "scenarios", "right", "wrong"),
        (
            (name, version, len(each), sum(row.right for row in each),
             ", ".join(row.scenario for row in each if not row.right))
            for (name, version), each in sorted(rows.items())
        ),
    )  # fmt: skip


def coverage(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the branch coverage of the parts that keep a flight safe."""
    if not found:
        return "Not measured yet."
    rows = [
        (
            f"`{name}`", f"{part['lines']:.1%}", f"{part['branches']:.1%}",
            ", ".join(part["missing"]) or "",
        )
        for name, part in found.items()
    ]  # fmt: skip
    return table(("part", "lines", "branches", "branches that no test takes"), rows)


def seeded(faults: Sequence[mutants.Mutant], results: Mapping[str, mutants.Found]) -> str:
    """Return the number of seeded faults of each part, and by what they were found."""
    rows = []
    for part in [*dict.fromkeys(fault.part for fault in faults), "all"]:
        found = [results.get(f.name, ["later"]) for f in faults if part in (f.part, "all")]
        by = Counter(each[0] if each else "" for each in found)
        rows.append((part, len(found), by["flight"], by["test"], by[""], by["later"]))
    header = ("part", "faults", "found by flights", "found by tests", "not found", "not sown yet")
    return table(header, rows)


def fuzzed(rows: Iterable[fuzz.Row]) -> str:
    """Return the runs of hostile inputs by target, and how many inputs ever failed."""
    found = defaultdict[str, list[fuzz.Row]](list)
    for row in rows:
        found[row["target"]].append(row)
    cells = [
        (
            name, DOORS[name], f"{sum(row['minutes'] for row in each):g}",
            f"{sum(row['executions'] for row in each):,}",
            max((row["branches"] or 0 for row in each), default=0) or "not measured",
            len(list(engine.kept(name))),
        )
        for name in DOORS if (each := found[name])
    ]  # fmt: skip
    header = ("target", "input", "CPU minutes", "inputs", "branches", "failed, mended")
    return table(header, cells) if cells else "Not run yet."


def failures(found: Iterable[Mapping[str, Any]]) -> str:
    """Return the list of failures that campaigns found, the newest first."""
    return "\n".join(_failure(each) for each in reversed(list(found)))


def _failure(found: Mapping[str, Any]) -> str:
    what, cause = (found[key][0].upper() + found[key][1:] for key in ("what", "cause"))
    mended = found["mended"]
    state = "**Open.**" if mended == "open" else f"Mended in `{mended}`."
    text = f"* `{found['world']}`, seed {found['seed']}. {what}. {cause}. {state}"
    return textwrap.fill(text, 118, subsequent_indent="  ", break_on_hyphens=False)


def page(runs: Sequence[Run]) -> str:
    """Return the page of a record of campaigns, without its last newline."""
    parts = {
        "campaigns": flown_text(runs), "troubles": injected(runs), "outcomes": outcomes(runs),
        "promises": promises(runs), "forgiven": forgiven(runs), "real": real(),
        "coverage": coverage(json.loads(COVERAGE.read_text("utf-8"))),
        "seeded": seeded(mutants.table()[0], mutants.results()),
        "fuzzed": fuzzed(fuzz.kept()),
        "failures": failures(tomllib.loads(FAILURES.read_text("utf-8"))["failure"]),
    }  # fmt: skip
    text = PAGE.read_text("utf-8")
    for name, part in parts.items():
        before, rest = text.split(f"<!-- {name} -->\n")
        text = f"{before}<!-- {name} -->\n{part}\n<!-- end -->{rest.split('<!-- end -->', 1)[1]}"
    return text


if __name__ == "__main__":
    PAGE.write_text(page(kept()), "utf-8")
