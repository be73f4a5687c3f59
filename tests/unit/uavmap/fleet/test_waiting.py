"""After its landing a member waits for the others; an operator may end the wait."""

from __future__ import annotations

import asyncio
from typing import cast

import pytest

from uavmap.fleet.fleet_radio import fleet_communication
from uavmap.fleet.member import Member


class Waits:
    """A member whose fellow members never land."""

    level = all_done = False

    async def run(self) -> None:
        await asyncio.Event().wait()

    def end(self) -> None:
        """Do nothing: no task needs an end."""


async def flight(landed: asyncio.Event, *, may_leave: bool) -> str:
    async with fleet_communication(cast(Member, Waits()), may_leave=may_leave):
        landed.set()
    return "results"


async def interrupt(*, may_leave: bool) -> str:
    landed = asyncio.Event()
    task = asyncio.create_task(flight(landed, may_leave=may_leave))
    await landed.wait()
    await asyncio.sleep(0)
    task.cancel()
    return await task


def test_operator_ends_the_wait_and_gets_the_results(log_lines):
    assert asyncio.run(interrupt(may_leave=True)) == "results"
    assert "Ctrl-C ends the wait" in log_lines[0]
    assert "uavmap merge" in log_lines[1]


def test_wait_without_an_operator_is_cancelled_like_any_task():
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(interrupt(may_leave=False))
