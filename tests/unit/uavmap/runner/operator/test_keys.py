"""The operator's keys: what each asks of the service, and a terminal that is left as it was."""

from __future__ import annotations

import asyncio
import os
import termios
from types import SimpleNamespace
from typing import Any, TextIO

import pytest

from tests.support.running import by, in_real_time
from tests.support.said import Said
from uavmap.runner.operator.flight_keys import FORGOTTEN_S, Keys
from uavmap.runner.operator.ground_crew import Crew, EnterKey
from uavmap.runner.operator.keyboard import keyboard


class Service:
    """Notes what it is asked for."""

    def __init__(self, vehicles: int = 3) -> None:
        self.asked: list[Any] = []
        self.state = SimpleNamespace(vehicles=dict.fromkeys(range(1, vehicles + 1)))

    def _note(self, *what: Any) -> bool:
        self.asked.append(what if len(what) > 1 else what[0])
        return True

    def pause(self) -> bool:
        return self._note("pause")

    def go_on(self) -> bool:
        return self._note("go on")

    def recall(self) -> None:
        self._note("recall")

    def recall_vehicle(self, number: int) -> bool:
        return self._note("recall", number)

    def skip_cell(self, number: int) -> bool:
        return self._note("skip", number)

    def land_here(self, number: int) -> bool:
        return self._note("land", number)


@pytest.mark.parametrize(
    ("pressed", "asked"),
    [
        ("p", ["pause"]),
        ("c", ["go on"]),
        ("pc", ["pause", "go on"]),
        ("ra", ["recall"]),
        ("rr", ["recall"]),
        ("r2", [("recall", 2)]),
        ("k3", [("skip", 3)]),
        ("q1q", [("land", 1)]),
        ("qaq", [("land", 1), ("land", 2), ("land", 3)]),
        ("q1", []),
        ("q1p", []),  # any other key: nobody lands, and nothing else happens
        ("q1\nq", []),
        ("r7", []),
        ("rp", ["pause"]),
        ("?x9", []),
    ],
)
def test_keys(pressed: str, asked: list[Any], said: Said) -> None:
    service = Service()
    keys = Keys(service)
    for key in pressed:
        keys.press(key)
    assert service.asked == asked
    assert said


def test_a_single_vehicle_needs_no_number() -> None:
    service = Service(vehicles=1)
    keys = Keys(service)
    for key in "rkqq":
        keys.press(key)
    assert service.asked == ["recall", ("skip", 1), ("land", 1)]


def test_a_number_of_two_digits_ends_with_the_second_or_enter() -> None:
    service = Service(vehicles=12)
    keys = Keys(service)
    for key in "r12r1\nr7":
        keys.press(key)
    assert service.asked == [("recall", 12), ("recall", 1), ("recall", 7)]


def test_a_key_that_waits_is_forgotten() -> None:
    service, now_s = Service(), [0.0]
    keys = Keys(service, lambda: now_s[0])
    keys.press("q")
    keys.press("1")
    now_s[0] += FORGOTTEN_S + 1.0
    keys.press("q")
    assert service.asked == []


@pytest.mark.parametrize("question", ["r", "q", "k"])
def test_enter_answers_the_question_that_was_asked_last(question: str) -> None:
    """Who is asked for a number and presses Enter has not said that anybody may take off."""
    keys = Keys(Service())
    assert not keys.press("\n")
    keys.press(question)
    assert keys.press("\n")


# --- the terminal ------------------------------------------------------------------------------
async def _until(condition: Any) -> None:
    async with asyncio.timeout(10.0):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.001)


@by(in_real_time)
async def test_a_key_is_heard_as_it_is_pressed_and_the_terminal_put_back(
    terminal: tuple[int, TextIO], said: Said
) -> None:
    operator, stream = terminal
    before = termios.tcgetattr(stream.fileno())
    service, enter = Service(), EnterKey()
    crew = Crew(automatic=False, enter=enter, stream=stream)
    with keyboard(Keys(service), enter, stream):
        assert not termios.tcgetattr(stream.fileno())[3] & (termios.ICANON | termios.ECHO)
        assert termios.tcgetattr(stream.fileno())[3] & termios.ISIG  # Ctrl-C stays a signal
        os.write(operator, b"p")
        await _until(lambda: service.asked == ["pause"])
        os.write(operator, b"\x1b[A")  # an arrow
        swapped = asyncio.create_task(crew.swap(2))
        await _until(lambda: any("vehicle 2" in text for text in said))
        os.write(operator, b"c")
        await _until(lambda: service.asked == ["pause", "go on"])
        assert not swapped.done()
        os.write(operator, b"\n")
        async with asyncio.timeout(10.0):
            await swapped
    assert termios.tcgetattr(stream.fileno()) == before


@pytest.mark.parametrize("end", [RuntimeError, KeyboardInterrupt, asyncio.CancelledError])
@by(in_real_time)
async def test_the_terminal_is_put_back_however_it_ends(
    terminal: tuple[int, TextIO], end: type[BaseException]
) -> None:
    _, stream = terminal
    before = termios.tcgetattr(stream.fileno())
    with (
        pytest.raises(end),
        keyboard(Keys(Service()), EnterKey(), stream),
    ):
        raise end
    assert termios.tcgetattr(stream.fileno()) == before


@by(in_real_time)
async def test_a_terminal_that_is_gone_is_nobodys_word(terminal: tuple[int, TextIO]) -> None:
    (operator, stream), enter = terminal, EnterKey()
    crew = Crew(automatic=False, enter=enter, stream=stream)
    with keyboard(Keys(Service()), enter, stream):
        swapped = asyncio.create_task(crew.swap(1))
        await asyncio.sleep(0)
        os.close(operator)
        _, waiting = await asyncio.wait([swapped], timeout=0.2)
        assert waiting
        swapped.cancel()
        await asyncio.wait([swapped])


def test_a_pipe_is_not_read(said: Said) -> None:
    read, write = os.pipe()
    os.write(write, b"q")
    with os.fdopen(read) as stream:
        with keyboard(Keys(Service()), EnterKey(), stream):
            pass
        assert stream.read(1) == "q"
    assert not said
    os.close(write)
