"""Measure the branch coverage of the parts that keep a flight safe: `python -m tests.coverage`.

The result is `tests/coverage.json`, which `python -m tests.reliability` shows.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
KEPT: Final = Path(__file__).with_name("coverage.json")
PARTS: Final = {
    "missions.guardian": "missions/guardian/",
    "missions.flight.airspace": "missions/flight/airspace/",
    "missions.mission.energy": "missions/mission/energy.py",
    "uavmap.aircraft.control": "uavmap/aircraft/control.py",
    "uavmap.mavlink.message_gate": "uavmap/mavlink/message_gate.py",
    "uavmap.journal": "uavmap/journal/",
}
TESTS: Final = (
    "tests/unit/missions", "tests/unit/uavmap/aircraft", "tests/unit/uavmap/mavlink",
    "tests/unit/uavmap/journal", "tests/unit/uavmap/runner", "tests/prop", "tests/campaign",
)  # fmt: skip


def summed(files: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Return the coverage of the files that begin with a prefix, and the branches not taken."""
    chosen = {name: found for name, found in files.items() if name.startswith(prefix)}
    totals = [found["summary"] for found in chosen.values()]

    def share(what: str, of: str) -> float:
        return sum(t[what] for t in totals) / max(1, sum(t[of] for t in totals))

    return {
        "lines": round(share("covered_lines", "num_statements"), 4),
        "branches": round(share("covered_branches", "num_branches"), 4),
        "missing": [
            f"{Path(name).name}:{begin}"
            for name, found in sorted(chosen.items())
            for begin, _ in found["missing_branches"]
        ],
    }


def measured(data: Path) -> Mapping[str, Any]:
    """Run the tests and return coverage's report by file."""
    parts = ",".join(f"{ROOT / part}{'/**' * part.endswith('/')}" for part in PARTS.values())
    run = [sys.executable, "-m", "coverage"]
    kept = f"--data-file={data / 'coverage'}"
    done = subprocess.run(
        [*run, "run", "--branch", kept, f"--include={parts}", "-m",
          "pytest", "-q", "-p", "no:xdist", *TESTS],
        cwd=ROOT, check=False,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit("tests failed: the coverage is not kept")
    report = data / "report.json"
    subprocess.run([*run, "json", kept, "-q", "-o", str(report)], cwd=ROOT, check=True)
    files: Mapping[str, Any] = json.loads(report.read_text("utf-8"))["files"]
    return files


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        files = measured(Path(folder))
    found = {name: summed(files, prefix) for name, prefix in PARTS.items()}
    KEPT.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
