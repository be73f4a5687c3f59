"""No vehicle takes off beside people before their answer: Enter, pressed after the question."""

from __future__ import annotations

import asyncio
import io
import os
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from missions.events import Airborne, BatterySwapped, Connected, Crashed
from missions.units import GridPoint
from tests.support.running import by
from uavmap.runner.operator.ground_crew import Crew, last_flights

SOON_S = 0.15
PATIENCE_S = 120.0


def on_loop(body: Callable[[], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        await body()
        assert len(asyncio.all_tasks()) == 1

    asyncio.run(main())


async def answered(task: asyncio.Task[None], within_s: float = SOON_S) -> bool:
    done, _ = await asyncio.wait([task], timeout=within_s)
    return bool(done)


async def drop(*tasks: asyncio.Task[None]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)


@by(on_loop)
async def test_simulated_crew_is_not_asked(log_lines):
    crew = Crew(automatic=True, stream=io.StringIO())
    await crew.swap(1)
    assert not crew.absent
    assert not crew.waiting
    assert not log_lines


@by(on_loop)
async def test_automatic_crew_is_asked_about_a_vehicle_that_was_down(terminal, log_lines):
    """A real PX4 took off 39 m from its pad, with --auto-swap and without a terminal."""
    alone = Crew(automatic=True, stream=io.StringIO())
    alone.doubt({1: "was down"})
    task = asyncio.create_task(alone.swap(1))
    assert not await answered(task)
    assert alone.keeps_waiting
    assert "vehicle 1 was down: it takes off only after Enter at a terminal" in log_lines[0]
    await drop(task)
    operator, stream = terminal
    crew = Crew(automatic=True, stream=stream)
    crew.doubt({1: "stands 39 m from its pad"})
    await crew.swap(2)
    task = asyncio.create_task(crew.swap(1))
    assert not await answered(task)
    assert not crew.keeps_waiting
    os.write(operator, b"\n")
    assert await answered(task, PATIENCE_S)
    assert "vehicle 1 stands 39 m from its pad: inspect it, swap its battery" in log_lines[1]
    await crew.swap(1)
    assert len(log_lines) == 2


@by(on_loop)
async def test_crew_answers_with_enter(terminal, log_lines):
    operator, stream = terminal
    crew = Crew(automatic=False, stream=stream)
    assert not crew.absent
    task = asyncio.create_task(crew.swap(3))
    assert not await answered(task)
    assert crew.waiting == {3}
    os.write(operator, b"not yet")
    assert not await answered(task)
    os.write(operator, b"\n")
    assert await answered(task, PATIENCE_S)
    assert crew.waiting == set()
    assert len(log_lines) == 1
    assert "vehicle 3" in log_lines[0]


@by(on_loop)
async def test_enter_pressed_before_the_question_is_no_answer(terminal):
    operator, stream = terminal
    os.write(operator, b"\n\n\n")
    await asyncio.sleep(SOON_S)
    crew = Crew(automatic=False, stream=stream)
    task = asyncio.create_task(crew.swap(1))
    assert not await answered(task)
    await drop(task)


@pytest.mark.parametrize("how", ["end of file", "hang-up"])
@by(on_loop)
async def test_terminal_that_is_gone_gives_no_answer(terminal, how):
    operator, stream = terminal
    crew = Crew(automatic=False, stream=stream)
    task = asyncio.create_task(crew.swap(1))
    assert not await answered(task)
    if how == "hang-up":
        os.close(operator)
    else:
        os.write(operator, b"\x04")
    assert not await answered(task)
    assert crew.waiting == {1}
    await drop(task)


@by(on_loop)
async def test_questions_are_asked_one_at_a_time(terminal, log_lines):
    operator, stream = terminal
    crew = Crew(automatic=False, stream=stream)
    first = asyncio.create_task(crew.swap(1))
    second = asyncio.create_task(crew.swap(2))
    assert not await answered(first)
    assert len(log_lines) == 1
    os.write(operator, b"\n")
    assert await answered(first, PATIENCE_S)
    assert not await answered(second)
    assert len(log_lines) == 2
    os.write(operator, b"\n")
    assert await answered(second, PATIENCE_S)


@pytest.mark.parametrize("stream", [io.StringIO("\n\n"), None], ids=["a pipe", "none"])
@by(on_loop)
async def test_crew_without_a_terminal_is_absent(stream, monkeypatch, log_lines):
    if stream is None:
        monkeypatch.setattr("sys.stdin", None)
    crew = Crew(automatic=False, stream=stream)
    assert crew.absent
    task = asyncio.create_task(crew.swap(1))
    assert not await answered(task)
    assert crew.waiting == {1}
    await drop(task)
    assert crew.waiting == set()
    assert log_lines == ["vehicle 1 waits on the ground for a fresh battery"]


PAD, FIELD = GridPoint(0.0, 0.0), GridPoint(39.0, 0.0)


def connected(place: GridPoint, *, airborne: bool) -> Connected:
    """Connect a vehicle whose autopilot counts its place as its home, as a real PX4 does."""
    home = PAD if airborne else place
    return Connected(1, 50.0, home, place, 12.0 * airborne, airborne, True, 60.0)


@pytest.mark.parametrize(
    ("events", "doubt"),
    [
        ([Airborne(1, 10.0, home=PAD)], "stands 39 m from its pad"),
        ([connected(PAD, airborne=True)], "stands 39 m from its pad"),
        (
            [Airborne(1, 10.0, home=PAD), Crashed(1, 20.0, FIELD, "it fell"),
             connected(FIELD, airborne=False)],
            "was down",
        ),
        ([Airborne(1, 10.0, home=PAD), BatterySwapped(1, 30.0, 60.0)], None),
        ([connected(FIELD, airborne=False)], None),
    ],
)  # fmt: skip
def test_last_flight_of_a_vehicle_decides_whether_to_ask_about_it(events, doubt):
    flights = last_flights(events)
    assert doubt == (flights[1].doubt(FIELD) if 1 in flights else None)


def test_vehicle_on_its_pad_is_not_asked_about():
    assert not last_flights([Airborne(1, 10.0, home=PAD)])[1].doubt(GridPoint(3.0, 0.0))
