"""Order of marks: the newest state only, each mark at its rate, all in turn."""

from dataclasses import replace

from uavmap.ui.tak.marks import Mark
from uavmap.ui.tak.outbox import REPEAT_S, Outbox

MARK = Mark("a", "u-d-f", 48.0, 11.0, "m-f", 60, b"<detail/>")


def test_mark_that_changes_waits_for_its_turn_and_the_newest_is_sent():
    outbox = Outbox()
    outbox.put("shapes", [MARK], 5.0)
    outbox.note_sent(MARK, 10.0)
    for lat_deg in (1.0, 2.0, 3.0):
        outbox.put("shapes", [replace(MARK, lat_deg=lat_deg)], 5.0)
    assert outbox.next(14.9) is None
    assert outbox.next_s(14.0) == 1.0
    assert outbox.next(15.0).lat_deg == 3.0


def test_mark_that_changes_while_it_is_written_is_sent_again():
    outbox = Outbox()
    outbox.put("shapes", [MARK], 0.0)
    writing = outbox.next(0.0)
    outbox.put("shapes", [replace(MARK, lat_deg=1.0)], 0.0)
    outbox.note_sent(writing, 1.0)
    assert not outbox.done
    assert outbox.next(1.0).lat_deg == 1.0


def test_unchanged_shape_is_repeated_seldom_and_an_aircraft_never():
    outbox, aircraft = Outbox(), replace(MARK, uid="b", repeats=False)
    outbox.put("shapes", [MARK], 5.0)
    outbox.put("aircraft", [aircraft], 1.0)
    for mark in (MARK, aircraft):
        outbox.note_sent(mark, 0.0)
    assert outbox.done
    assert outbox.next(REPEAT_S - 0.1) is None
    assert outbox.next(REPEAT_S) == MARK
    outbox.note_sent(MARK, REPEAT_S)
    assert outbox.next(REPEAT_S) is None


def test_new_connection_gets_all_marks_and_deletions_at_once():
    outbox, gone = Outbox(), replace(MARK, uid="gone")
    outbox.put("shapes", [MARK, gone], 5.0)
    for mark in (MARK, gone):
        outbox.note_sent(mark, 0.0)
    outbox.put("shapes", [MARK], 5.0)
    outbox.note_sent(outbox.next(5.0), 5.0)
    assert outbox.next(6.0) is None
    outbox.renew()
    sent = []
    while (mark := outbox.next(6.0)) is not None:
        sent.append(mark.uid)
        outbox.note_sent(mark, 6.0)
    assert sent == ["a", "gone-delete"]


def test_marks_take_turns_on_a_slow_link():
    outbox, sent = Outbox(), []
    for k in range(12):
        marks = [replace(MARK, uid=name, lat_deg=float(k)) for name in "abc"]
        outbox.put("aircraft", marks, 0.0)
        mark = outbox.next(float(k))
        sent.append(mark.uid)
        outbox.note_sent(mark, float(k))
    assert sent == list("abc") * 4


def test_mark_that_returns_after_a_deletion_is_sent_as_new():
    outbox = Outbox()
    for marks in ([MARK], [], [MARK]):
        outbox.put("shapes", marks, 0.0)
        outbox.note_sent(outbox.next(0.0), 0.0)
    assert outbox.done
