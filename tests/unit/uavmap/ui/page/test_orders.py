"""What the page may ask of a service, and nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from uavmap.ui.page.live import carry_out
from uavmap.ui.page.page_pipe import Lines, packed


class Service:
    """Notes what it is asked for."""

    flying = True

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.state = type("State", (), {"vehicles": {1: None, 2: None}})

    def pause(self) -> bool:
        self.asked.append("pause")
        return len(self.asked) == 1

    def go_on(self) -> bool:
        self.asked.append("go on")
        return True

    def recall(self) -> None:
        self.asked.append("recall")

    def recall_vehicle(self, number: int) -> bool:
        self.asked.append(number)
        return True

    def skip_cell(self, number: int) -> bool:
        raise AssertionError("no order of the page")

    def land_here(self, number: int) -> bool:
        raise AssertionError("no order of the page")


@pytest.mark.parametrize(
    ("order", "asked", "answer"),
    [
        ({"do": "pause"}, ["pause"], "paused"),
        ({"do": "continue"}, ["go on"], "goes on"),
        ({"do": "return", "vehicle": None}, ["recall"], "everybody comes home"),
        ({"do": "return", "vehicle": 2}, [2], "vehicle 2 comes home"),
        ({"do": "return", "vehicle": 3}, [], "no vehicle 3"),
        ({"do": "return", "vehicle": True}, [], "no order"),
        ({"do": "return"}, [], "no order"),
        ({"do": "return", "vehicle": "1"}, [], "no order"),
        ({"do": "land_here", "vehicle": 1}, [], "no order"),
        ({"do": ["pause"]}, [], "no order"),
        ({}, [], "no order"),
    ],
)
def test_the_orders(order: dict[str, Any], asked: list[Any], answer: str) -> None:
    service = Service()
    assert answer in carry_out(service, order)
    assert service.asked == asked


def test_nobody_is_ordered_before_or_after_the_flight() -> None:
    service = Service()
    service.flying = False
    assert "nobody flies" in carry_out(service, {"do": "pause"})
    assert service.asked == []


def test_it_is_said_that_it_is_paused_already() -> None:
    service = Service()
    carry_out(service, {"do": "pause"})
    assert "already" in carry_out(service, {"do": "pause"})


def test_lines_that_are_no_words_are_left_out() -> None:
    lines = Lines()
    assert lines.of(b'[1]\nx\n\xff\n{"a":1}\n' + b"y" * 10_000) == [{"a": 1}]
    assert lines.of(b'\n{"b":2}\n') == [{"b": 2}]


def test_a_message_has_its_lengths() -> None:
    assert packed({}, b"abc") == b"\0\0\0\2\0\0\0\3{}abc"
