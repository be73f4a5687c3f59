"""A page beside a flight: it gets all reports, and never ends or changes the flight."""

import asyncio
import json
import os
from pathlib import Path
from unittest.mock import Mock, call

import pytest

from missions.events import from_json
from missions.flight.step import step
from tests.golden.recording import STOPS
from tests.support.page.page_feed import Feed
from tests.support.plans import named_text, plan_of
from uavmap.base.messages import shown_on
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly
from uavmap.runner.operator.company import Company
from uavmap.runner.service import Service
from uavmap.ui.page.live import SIMULATED, FlightPage, carry_out
from uavmap.ui.page.live_board import LiveBoard, Reader
from uavmap.ui.page.page_pipe import Lines, packed
from uavmap.ui.page.page_scene import STATES


def steered():
    return Mock(spec=Service, flying=True, state=Mock(vehicles={1: None, 2: None}))


@pytest.mark.parametrize(
    ("order", "asked", "answer"),
    [
        ({"do": "pause"}, [call.pause()], "paused"),
        ({"do": "continue"}, [call.go_on()], "continues"),
        ({"do": "return", "vehicle": None}, [call.recall()], "all vehicles return"),
        ({"do": "return", "vehicle": 2}, [call.recall_vehicle(2)], "vehicle 2 returns"),
        ({"do": "return", "vehicle": 3}, [], "no vehicle 3"),
        ({"do": "return", "vehicle": True}, [], "unknown order"),
        ({"do": "return"}, [], "unknown order"),
        ({"do": "return", "vehicle": "1"}, [], "unknown order"),
        ({"do": "land_here", "vehicle": 1}, [], "unknown order"),
        ({"do": ["pause"]}, [], "unknown order"),
        ({}, [], "unknown order"),
    ],
)
def test_order_of_the_page_calls_the_service(order, asked, answer):
    service = steered()
    assert answer in carry_out(service, order)
    assert service.mock_calls == asked


def test_order_before_or_after_the_flight_or_twice_is_refused():
    service = steered()
    service.pause.return_value = False
    assert "already" in carry_out(service, {"do": "pause"})
    service.flying = False
    assert "no vehicle flies" in carry_out(service, {"do": "pause"})
    assert service.mock_calls == [call.pause()]


def test_lines_that_are_no_messages_are_left_out():
    lines = Lines()
    assert lines.parse(b'[1]\nx\n\xff\n{"a":1}\n' + b"y" * 10_000) == [{"a": 1}]
    assert lines.parse(b'\n{"b":2}\n') == [{"b": 2}]


def test_message_has_its_lengths():
    assert packed({}, b"abc") == b"\0\0\0\2\0\0\0\3{}abc"


MISSION = str(Path(__file__).parents[4] / "data" / "speck.toml")


BROKEN = (
    "the live page has failed (RuntimeError: the page is broken); the flight continues without it"
)


class LineQueue:
    def __init__(self):
        self.lines = asyncio.Queue()

    def show(self, text):
        self.lines.put_nowait(text)


def ticking():
    """Return a clock that advances by 0.07 s at each call."""
    times = iter(range(10**9))
    return lambda: 0.07 * next(times)


def test_flight_is_the_same_beside_a_page_that_works_or_breaks(tmp_path, log_lines):
    source, broken = named_text(MISSION), Feed(20)
    plan = plan_of(source.source, source.text, "rdfs", 1, 3, (), None, SIM_EPOCH_UTC_S)
    feed = Feed()
    page = FlightPage(feed, simulated=True, now_s=ticking())
    breaking = FlightPage(broken, simulated=True, now_s=ticking())
    with shown_on(page, breaking):
        summary = fly(plan, tmp_path, Company(onlookers=(page, breaking)))
    assert summary["completed"]
    page.close("the flight is over")
    breaking.close("the flight is over")
    assert [line for line in log_lines if "live page" in line] == [BROKEN]
    kinds, board = feed.kinds, feed.board
    assert (kinds[0], kinds[-1]) == ("scene", "ended")
    codes = [STATES[code] for code in board.cells.values()]
    assert codes.count("explored") == summary["cells_roi"] == board.field("roi")
    assert board.field("certificate")["lower_bound_s"] == summary["lower_bound_s"]
    assert board.field("picture")["cells"]
    assert "picture" in kinds
    assert kinds.count("delta") > 20
    vehicle = board.since(0)["vehicles"]["1"]  # by the messages of the aircraft's side
    assert (vehicle["satellites"], vehicle["hdop"], vehicle["loss_percent"]) == (10, 1.21, 0)
    assert 10.0 < vehicle["volts"] < 30.0
    assert vehicle["late_s"] < 1.0
    assert vehicle["mode"] in ("GUIDED", "LAND", "RTL")


def show_flight(feed):
    setting, page = STOPS.setting(), FlightPage(feed, simulated=True, now_s=ticking())
    state = setting.initial_state()
    page.begin(setting, again=False)
    for line in STOPS.lines():
        state, _ = step(state, event := from_json(line))
        page.update(event, state, 0)
    page.end()
    return page


class Reporting(Feed):
    title = "the TAK link"

    def __init__(self):
        super().__init__()
        self.lines = [{"report": "TAK: linked"}, {"do": "return"}]

    def orders(self):
        lines, self.lines = self.lines, []
        return lines


def test_readers_beside_a_page_and_without_one_end_with_the_same_board(log_lines):
    page, beside, alone = Feed(), Reporting(), Reporting()
    setting, clock = STOPS.setting(), ticking()
    boards = (
        FlightPage(page, simulated=True, now_s=clock, others=[Reader(beside, 0.5, reports=True)]),
        LiveBoard([Reader(alone, 0.5, reports=True)], simulated=True, now_s=clock),
    )
    state = setting.initial_state()
    for board in boards:
        board.begin(setting, again=False)
    for line in STOPS.lines():
        state, _ = step(state, event := from_json(line))
        for board in boards:
            board.update(event, state, 0)
    for board in boards:
        board.end()
        board.close("the flight is over")
    assert log_lines == ["TAK: linked"] * 2  # and a message that is no report is no order either
    snapshots = [feed.board.since(0) for feed in (page, beside, alone)]
    for part in ("cells", "vehicles", "tracks", "log"):
        first, *others = (sorted(map(repr, _parts(s[part]))) for s in snapshots)
        assert others == [first] * 2, part
    assert len(alone.deltas) < len(page.deltas)
    assert "picture" not in beside.kinds


def _parts(part):
    if isinstance(part, dict):
        return part.items()
    return zip(*[iter(part)] * 3, strict=True) if isinstance(part[0], int) else part


@pytest.mark.parametrize("breaks_at", [0, 1, 2, 90])
def test_page_that_fails_at_any_time_is_reported_once(breaks_at, log_lines):
    page = show_flight(Feed(breaks_at))
    page.show("something else")
    page.close("the flight is over")
    assert log_lines == [BROKEN]


def test_page_that_never_reads_gets_no_more():
    class Full(Feed):
        idle = property(lambda self: False)

    feed = Full()
    show_flight(feed)
    assert feed.kinds == ["scene", "delta"]  # the last one, at the end


def test_simulated_flight_takes_no_orders():
    feed = Feed()
    show_flight(feed)
    assert feed.deltas[0]["fields"]["hands_off"] == SIMULATED


def test_orders_reach_the_service_while_it_flies_and_not_before_or_after(log_lines):
    read, write = os.pipe()
    os.set_blocking(read, False)
    lines, service = Lines(), steered()
    service.go_on.side_effect = RuntimeError("a defect")

    class Piped(Feed):
        orders_file = read

        def orders(self):
            try:
                return lines.parse(os.read(read, 1000))
            except BlockingIOError:
                return []

    def ask(order):
        os.write(write, json.dumps({"do": order, "id": "7"}).encode() + b"\n")

    feed = Piped()
    page = FlightPage(feed, simulated=False)
    page.begin(STOPS.setting(), again=False)

    async def flight():
        ask("pause")  # before any vehicle could fly: dropped
        heard = LineQueue()
        with shown_on(heard), page.steering(service):
            await asyncio.sleep(0.01)
            assert service.mock_calls == []
            ask("pause")
            await heard.lines.get()
            ask("continue")  # an error inside ends the page only
            await heard.lines.get()
        ask("pause")
        await asyncio.sleep(0.01)

    asyncio.run(flight())
    assert service.mock_calls == [call.pause(), call.go_on()]
    assert log_lines[0] == "page: paused: all vehicles hold"
    assert {"kind": "answer", "id": "7", "text": "paused: all vehicles hold"} in [
        words for words, _ in feed.told
    ]
    assert "a defect" in log_lines[1]
    os.close(read)
    os.close(write)
