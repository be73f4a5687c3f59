"""Signals while a simulated flight runs on its loop: one ends it as Ctrl-C does."""

from __future__ import annotations

import asyncio
import os
import signal
from unittest.mock import Mock

import pytest

from uavmap.base.clock import VirtualClock, run
from uavmap.runner.operator.interrupts import interrupts, like_control_c
from uavmap.runner.service import Service


@pytest.mark.parametrize("interrupt", [signal.SIG_IGN, signal.default_int_handler])
def test_background_job_that_gets_sigterm_cleans_up(interrupt):
    before = signal.signal(signal.SIGINT, interrupt)
    tidied = []

    async def busy() -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            await asyncio.sleep(3600.0)
        finally:
            await asyncio.sleep(1.0)
            tidied.append(True)

    try:
        with pytest.raises(KeyboardInterrupt), like_control_c():
            run(busy(), VirtualClock())
    finally:
        signal.signal(signal.SIGINT, before)
    assert tidied
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize(("over", "presses"), [(True, 2), (False, 1)])
def test_first_press_after_the_last_landing_does_not_cut_the_end_short(over, presses):
    counted = 0
    service = Mock(spec=Service, flying=False, ended=True, state=Mock(is_over=over))

    async def ending() -> None:
        nonlocal counted
        with interrupts(service):
            while True:
                counted += 1
                os.kill(os.getpid(), signal.SIGINT)
                await asyncio.sleep(1.0)

    with pytest.raises(KeyboardInterrupt):
        run(ending(), VirtualClock())
    assert counted == presses


def test_task_cancelled_for_another_reason_is_no_interrupt():
    async def cancelled() -> None:
        raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError), like_control_c():
        run(cancelled(), VirtualClock())
