"""A journal on a disk of which each call fails once: what was confirmed is kept."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest

from missions.errors import JournalError
from missions.events import Continued, Paused, to_json
from tests.failing_disk import HOWS, How, Killed, failing_disk
from uavmap.journal.event_log import Journal, JournalReader


def write(path: Path, confirmed: list[str]) -> None:
    """Write a journal as a flight and a resumed one do; add each event that it confirms."""
    with Journal.create(path, {"plan": {}}) as journal:
        for k in range(2):
            journal.append(Paused(float(k)))
            confirmed.append(to_json(Paused(float(k))))
        journal.put_meta("keep", True)
    with Journal.open(path) as journal:
        pair = [Continued(2.0), Paused(3.0)]
        journal.append_all(pair)
        confirmed += map(to_json, pair)
        with suppress(JournalError):  # the flight goes on as long as it must
            journal.append(Continued(4.0))
            confirmed.append(to_json(Continued(4.0)))
        journal.append(Paused(5.0))
        confirmed.append(to_json(Paused(5.0)))


@pytest.mark.parametrize("how", HOWS)
def test_journal_each_call_fails_once_keeps_confirmed_events(how: How, tmp_path: Path) -> None:
    fails_at, failed = 0, True
    while failed:
        fails_at += 1
        path = tmp_path / str(fails_at) / "journal.jsonl"
        path.parent.mkdir()
        confirmed: list[str] = []
        with failing_disk(path.parent, fails_at, how) as disk:
            with suppress(JournalError, Killed):
                write(path, confirmed)
            failed = disk.failed
        if not path.exists():
            assert confirmed == []
            continue
        bodies = JournalReader(path).bodies()
        assert bodies[: len(confirmed)] == confirmed, disk.calls[-1]
        assert len(bodies) <= len(confirmed) + 2, disk.calls[-1]
        with Journal.open(path) as journal:  # and it goes on
            journal.append(Paused(9.0))
        assert JournalReader(path).bodies() == [*bodies, to_json(Paused(9.0))]
    assert fails_at > 15
