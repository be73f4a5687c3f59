"""Fly the golden missions anew and record their events: `python -m tests.golden.renew [NAME ...]`.

Run it when the service is meant to act differently, never to make a test pass. Examine the
difference of the outcomes before you commit them. With `--outcomes` the recorded events stay:
use it for a summary with more figures of the same flight.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from missions.events import from_json
from tests.golden.recording import RECORDINGS, Recording, outcome
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.runner.flight import fly


def events_of(recording: Recording, folder: Path) -> list[str]:
    source = named_text(recording.mission)
    plan = plan_of(*source, strategy=recording.strategy, seed=recording.seed)
    fly(plan, folder)
    with Journal.open(folder / JOURNAL) as journal:
        return journal.bodies()


def main() -> None:
    parser = argparse.ArgumentParser(description="Fly the golden missions anew.")
    parser.add_argument("names", nargs="*", choices=[[], *(r.name for r in RECORDINGS)])
    parser.add_argument("--outcomes", action="store_true", help="of the events as recorded")
    options = parser.parse_args()
    names = options.names
    for recording in RECORDINGS:
        if names and recording.name not in names:
            continue
        if options.outcomes:
            bodies = recording.lines()
        else:
            with tempfile.TemporaryDirectory() as folder:
                bodies = events_of(recording, Path(folder) / "flight")
        recording.write(bodies, outcome(recording, [from_json(body) for body in bodies]))
        print(recording.name, len(bodies), "events", recording.events.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
