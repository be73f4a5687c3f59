from __future__ import annotations

import asyncio
import os
import signal
import socket
import time

import pytest

from tests.support.running import by, on_virtual_time
from uavmap.base.clock import ClockRate, ScaledClock, VirtualClock, run


async def at_s(delay_s: float) -> float:
    await asyncio.sleep(delay_s)
    return asyncio.get_running_loop().time()


@by(on_virtual_time)
async def test_virtual_time_runs_in_the_order_of_the_timers():
    seen: list[tuple[str, float]] = []

    async def one(name: str, delays_s: list[float]) -> None:
        for delay_s in delays_s:
            seen.append((name, await at_s(delay_s)))

    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(one("a", [1.0, 2.0, 0.5]))
        tasks.create_task(one("b", [0.25, 0.25, 3.25]))
    assert seen == [("b", 0.25), ("b", 0.5), ("a", 1.0), ("a", 3.0), ("a", 3.5), ("b", 3.75)]


@by(on_virtual_time)
async def test_small_steps_of_virtual_time_do_not_drift():
    loop = asyncio.get_running_loop()
    for step in range(20_000):
        await asyncio.sleep((step + 1) * 0.05 - loop.time())
    assert loop.time() == pytest.approx(1000.0, abs=1e-6)


@by(on_virtual_time)
async def test_virtual_time_stands_still_while_a_task_works():
    assert await at_s(0.0) == 0.0
    for _ in range(100):
        await asyncio.sleep(0)
    assert await at_s(0.0) == 0.0


@by(on_virtual_time)
async def test_time_out_is_virtual():
    begin_s = time.monotonic()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(600.0):
            await asyncio.get_running_loop().create_future()
    assert await at_s(0.0) == pytest.approx(600.0)
    assert time.monotonic() - begin_s < 1.0


@pytest.mark.parametrize("make", [VirtualClock, ScaledClock])
def test_clock_with_a_pace_is_faster_than_real_time(make):
    begin_s = time.monotonic()
    assert run(at_s(20.0), make(200.0)) >= 20.0
    assert 0.09 < time.monotonic() - begin_s < 2.0


@pytest.mark.parametrize(
    "make", [VirtualClock, lambda: VirtualClock(pace=5.0), lambda: ScaledClock(5.0)]
)
def test_socket_is_served_before_time_moves_on(make):
    async def main() -> tuple[bytes, float]:
        here, there = socket.socketpair()
        here.setblocking(False)
        with here, there:
            loop = asyncio.get_running_loop()
            there.send(b"frame")
            async with asyncio.timeout(5.0):
                return await loop.sock_recv(here, 16), loop.time()

    data, now_s = run(main(), make())
    assert data == b"frame"
    assert now_s < 5.0


@pytest.mark.parametrize("make", [lambda: VirtualClock(pace=1.0), ScaledClock])
def test_signal_is_handled_at_once(make):
    async def main() -> None:
        loop = asyncio.get_running_loop()
        heard = asyncio.Event()
        loop.add_signal_handler(signal.SIGUSR1, heard.set)
        loop.call_soon(os.kill, os.getpid(), signal.SIGUSR1)
        try:
            async with asyncio.timeout(30.0):
                await heard.wait()
        finally:
            loop.remove_signal_handler(signal.SIGUSR1)

    begin_s = time.monotonic()
    run(main(), make())
    assert time.monotonic() - begin_s < 5.0


def test_signal_between_virtual_instants_is_handled():
    async def main() -> float:
        loop = asyncio.get_running_loop()
        heard = asyncio.Event()
        loop.add_signal_handler(signal.SIGUSR1, heard.set)
        loop.call_later(7.0, os.kill, os.getpid(), signal.SIGUSR1)
        ticking = asyncio.create_task(tick())
        await heard.wait()
        now_s = loop.time()
        ticking.cancel()
        loop.remove_signal_handler(signal.SIGUSR1)
        return now_s

    async def tick() -> None:
        for _ in range(1000):
            await asyncio.sleep(0.05)

    assert run(main(), VirtualClock()) == pytest.approx(7.0, abs=0.1)


@pytest.mark.filterwarnings("error")
def test_run_cancels_remaining_tasks_and_raises_errors():
    seen: list[str] = []

    async def straggler() -> None:
        try:
            await asyncio.sleep(1e9)
        except asyncio.CancelledError:
            seen.append("cancelled")
            raise

    async def main() -> None:
        task = asyncio.create_task(straggler())
        await asyncio.sleep(1.0)
        assert not task.done()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(main(), VirtualClock())
    assert seen == ["cancelled"]


# --- the pace of a vehicle's time ------------------------------------------------------------
def speed_lines(rate: float, speedup: float = 1.0, seconds: int = 60) -> list[str]:
    clock = ClockRate(10.0 * speedup, speedup)
    steps = range(int(seconds * speedup))
    return [text for t in steps if (text := clock.check(float(t), 1000.0 + rate * t))]


@pytest.mark.parametrize("rate", [0.7, 0.8, 1.0, 1.3])
def test_busy_machine_is_not_a_wrong_speedup(rate):
    assert speed_lines(rate) == []


@pytest.mark.parametrize(
    ("speedup", "rate", "meant"), [(1.0, 10.0, "10"), (10.0, 0.3, "3"), (10.0, 0.1, "1")]
)
def test_wrong_speedup_is_reported_once_with_the_right_one(speedup, rate, meant):
    (text,) = speed_lines(rate, speedup)
    assert f"--speedup {meant} meant" in text


def test_restart_of_the_vehicle_is_no_wrong_speedup():
    clock = ClockRate(10.0, 1.0)
    times = [*range(20), *range(3), *range(3, 40)]
    assert not any(clock.check(float(t), float(boot)) for t, boot in enumerate(times))
