"""Which message is due when, against a model that asks each message by itself."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from sitl.mavlink.streams import Streams


class OneByOne:
    """Every message keeps its own next time."""

    def __init__(self):
        self.every, self.next = {}, {}

    def set(self, message_id, interval_s, now_s):
        if interval_s is None:
            self.every.pop(message_id, None)
            self.next.pop(message_id, None)
        else:
            self.every[message_id], self.next[message_id] = interval_s, now_s + interval_s

    def due(self, now_s):
        now_s += 1e-6
        due = [number for number, at_s in self.next.items() if at_s <= now_s]
        for number in due:
            self.next[number] = max(self.next[number] + self.every[number], now_s)
        return due


asked = st.tuples(
    st.integers(1, 6), st.sampled_from([None, 0.01, 0.05, 0.1, 0.1, 0.25, 1.0, 1.0 / 3.0])
)


@given(st.lists(st.one_of(asked, st.sampled_from([0.05, 0.05, 0.013, 0.4])), max_size=60))
def test_as_if_each_message_were_alone(events):
    streams, model, now_s = Streams(), OneByOne(), 0.0
    for event in events:
        if isinstance(event, float):
            now_s += event
            assert streams.due(now_s) == model.due(now_s)
        else:
            streams.set(*event, now_s)
            model.set(*event, now_s)
    assert {n: streams.interval_s(n) for n in range(7)} == {n: model.every.get(n) for n in range(7)}


def test_what_is_due_is_the_callers_own():
    streams = Streams()
    streams.set(30, 0.1, 0.0)
    streams.due(0.1).clear()
    assert streams.due(0.2) == [30]
