"""Lines for the operator go to the displays of their own flight, and to no other."""

from __future__ import annotations

import asyncio
import logging
import threading

from tests.support.shown_lines import ShownLines
from uavmap.base.messages import bound, muted, prefixed, shown_on

LOG = logging.getLogger("uavmap.flight")


def test_lines_are_shown_as_they_are_while_a_display_is_there():
    one, page = ShownLines(), ShownLines()
    LOG.info("before")
    with shown_on(one):
        LOG.info("100 % of the box\nsecond")
        with shown_on(page):
            LOG.info("on both")
    LOG.info("after")
    assert one == ["100 % of the box\nsecond", "on both"]
    assert page == ["on both"]
    assert not LOG.isEnabledFor(logging.INFO)


def test_flights_in_threads_at_the_same_time_keep_their_lines_apart():
    both, shown = threading.Barrier(3), {name: ShownLines() for name in ("one", "other")}

    def fly(name: str) -> None:
        with shown_on(shown[name]):
            both.wait()
            LOG.info(name)
            both.wait()

    def fly_quietly() -> None:
        with muted():
            both.wait()
            LOG.info("nobody reads this")
            both.wait()

    flights = [threading.Thread(target=fly, args=(name,)) for name in shown]
    flights.append(threading.Thread(target=fly_quietly))
    for flight in flights:
        flight.start()
    for flight in flights:
        flight.join()
    assert shown == {"one": ["one"], "other": ["other"]}


def test_members_in_tasks_begin_their_lines_with_their_number():
    lines, made = ShownLines(), {}

    async def member(number: int) -> None:
        with prefixed(f"vehicle {number}: "):
            made[number] = bound("uavmap.fleet")
            await asyncio.sleep(0)
            LOG.info("is here")

    async def fleet() -> None:
        async with asyncio.TaskGroup() as tasks:
            for number in (1, 2):
                tasks.create_task(member(number))
        LOG.info("all are here")
        made[2].line("is heard by another")

    with shown_on(lines):
        asyncio.run(fleet())
    assert lines == [
        "vehicle 1: is here", "vehicle 2: is here", "all are here",
        "vehicle 2: is heard by another",
    ]  # fmt: skip


def test_thread_without_a_context_is_shown_by_all():
    lines = ShownLines()
    with shown_on(lines):
        thread = threading.Thread(target=LOG.info, args=("from a driver's thread",))
        thread.start()
        thread.join()
    assert lines == ["from a driver's thread"]
