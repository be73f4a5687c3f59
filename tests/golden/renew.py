"""Fly the golden mission anew and record its events: `python -m tests.golden.renew`.

To be done when the service is meant to act differently, never to make a test pass: look at the
difference of `outcome.json` before it is committed.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from tests.golden.recording import EVENTS, MISSION, OUTCOME, SEED, outcome
from uavmap.fly.flight import fly
from uavmap.fly.progress import Silent
from uavmap.record.flight_plan import JOURNAL, SIM_EPOCH_UTC_S, FlightPlan
from uavmap.record.journal import Journal


def flown(folder: Path) -> list[str]:
    """The texts of the events of the golden mission, flown now."""
    plan = FlightPlan(
        str(MISSION),
        MISSION.read_text("utf-8"),
        strategy=None,
        vehicles=None,
        seed=SEED,
        urls=(),
        speedup=None,
        epoch_utc_s=SIM_EPOCH_UTC_S,
    )
    fly(plan, folder, Silent())
    with Journal.open(folder / JOURNAL) as journal:
        return journal.bodies()


def main() -> None:
    """Write `events.jsonl` and `outcome.json`."""
    with tempfile.TemporaryDirectory() as folder:
        bodies = flown(Path(folder) / "flight")
        with Journal.open(Path(folder) / "flight" / JOURNAL) as journal:
            events = list(journal.events())
    EVENTS.write_text("\n".join(bodies) + "\n", "utf-8")
    OUTCOME.write_text(json.dumps(outcome(events), indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
