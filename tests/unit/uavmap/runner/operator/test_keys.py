"""The operator's keys: the order that each gives to the service, and the restored terminal."""

from __future__ import annotations

import asyncio
import os
import termios
from typing import Any
from unittest.mock import Mock, call

import pytest

from tests.support.running import by, in_real_time
from uavmap.runner.operator.ground_crew import Crew, EnterKey
from uavmap.runner.operator.keyboard import KEY_TIMEOUT_S, Keys, keyboard
from uavmap.runner.service import Service


def steered(vehicles: int = 3) -> Mock:
    """Return a service that records its orders."""
    return Mock(spec=Service, state=Mock(vehicles=dict.fromkeys(range(1, vehicles + 1))))


def pressed_in(keys: str, service: Mock) -> list[Any]:
    """Return the orders that a service got when keys were pressed."""
    taking = Keys(service)
    for key in keys:
        taking.press(key)
    return service.mock_calls


@pytest.mark.parametrize(
    ("pressed", "asked"),
    [
        ("p", [call.pause()]),
        ("c", [call.go_on()]),
        ("pc", [call.pause(), call.go_on()]),
        ("ra", [call.recall()]),
        ("rr", [call.recall()]),
        ("r2", [call.recall_vehicle(2)]),
        ("k3", [call.skip_cell(3)]),
        ("q1q", [call.land_here(1)]),
        ("qaq", [call.land_here(1), call.land_here(2), call.land_here(3)]),
        ("q1", []),
        ("q1p", []),  # any other key: no vehicle lands, and no order is given
        ("q1\nq", []),
        ("r7", []),
        ("rp", [call.pause()]),
        ("?x9", []),
    ],
)
def test_key_gives_its_order_and_a_line(pressed, asked, log_lines):
    assert pressed_in(pressed, steered()) == asked
    assert log_lines


def test_key_for_a_single_vehicle_needs_no_number():
    asked = pressed_in("rkqq", steered(vehicles=1))
    assert asked == [call.recall(), call.skip_cell(1), call.land_here(1)]


def test_number_of_two_digits_ends_with_the_second_or_enter():
    asked = pressed_in("r12r1\nr7", steered(vehicles=12))
    assert asked == [call.recall_vehicle(n) for n in (12, 1, 7)]


def test_key_that_waits_for_a_number_is_forgotten():
    service, now_s = steered(), [0.0]
    keys = Keys(service, lambda: now_s[0])
    keys.press("q")
    keys.press("1")
    now_s[0] += KEY_TIMEOUT_S + 1.0
    keys.press("q")
    assert service.mock_calls == []


@pytest.mark.parametrize("question", ["r", "q", "k"])
def test_enter_answers_the_question_that_was_asked_last(question):
    keys = Keys(steered())
    assert not keys.press("\n")
    keys.press(question)
    assert keys.press("\n")


# --- the terminal ------------------------------------------------------------------------------
async def _until(condition: Any) -> None:
    async with asyncio.timeout(10.0):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.001)


@by(in_real_time)
async def test_key_is_read_when_pressed_and_the_terminal_restored(terminal, log_lines):
    operator, stream = terminal
    before = termios.tcgetattr(stream.fileno())
    service, enter = steered(), EnterKey()
    crew = Crew(automatic=False, enter=enter, stream=stream)
    with keyboard(Keys(service), enter, stream):
        assert not termios.tcgetattr(stream.fileno())[3] & (termios.ICANON | termios.ECHO)
        assert termios.tcgetattr(stream.fileno())[3] & termios.ISIG  # Ctrl-C stays a signal
        os.write(operator, b"p")
        await _until(lambda: service.mock_calls == [call.pause()])
        os.write(operator, b"\x1b[A")  # an arrow
        swapped = asyncio.create_task(crew.swap(2))
        await _until(lambda: any("vehicle 2" in text for text in log_lines))
        os.write(operator, b"c")
        await _until(lambda: service.mock_calls == [call.pause(), call.go_on()])
        assert not swapped.done()
        os.write(operator, b"\n")
        async with asyncio.timeout(10.0):
            await swapped
    assert termios.tcgetattr(stream.fileno()) == before


@pytest.mark.parametrize("end", [RuntimeError, KeyboardInterrupt, asyncio.CancelledError])
@by(in_real_time)
async def test_terminal_is_restored_after_any_end(terminal, end):
    _, stream = terminal
    before = termios.tcgetattr(stream.fileno())
    with pytest.raises(end), keyboard(Keys(steered()), EnterKey(), stream):
        raise end
    assert termios.tcgetattr(stream.fileno()) == before


@by(in_real_time)
async def test_terminal_that_is_gone_gives_no_order(terminal):
    (operator, stream), enter = terminal, EnterKey()
    crew = Crew(automatic=False, enter=enter, stream=stream)
    with keyboard(Keys(steered()), enter, stream):
        swapped = asyncio.create_task(crew.swap(1))
        await asyncio.sleep(0)
        os.close(operator)
        _, waiting = await asyncio.wait([swapped], timeout=0.2)
        assert waiting
        swapped.cancel()
        await asyncio.wait([swapped])


def test_pipe_is_not_read(log_lines):
    read, write = os.pipe()
    os.write(write, b"q")
    with os.fdopen(read) as stream:
        with keyboard(Keys(steered()), EnterKey(), stream):
            pass
        assert stream.read(1) == "q"
    assert not log_lines
    os.close(write)
