"""Every source of pictures fulfils the same contract."""

import asyncio
import itertools
from pathlib import Path

import pytest

from tests.unit.uavmap.aircraft.cameras.conformance import BENCHES, triggered_bench
from uavmap.base.clock import VirtualClock, run

RIGHT_S = 0.05


def on_each_bench(body):
    @pytest.mark.parametrize("kind", sorted(BENCHES))
    def test(kind, tmp_path):
        async def main():
            async with asyncio.timeout(300.0), BENCHES[kind](tmp_path) as bench:
                await body(bench)

        run(main(), VirtualClock())

    test.__name__ = body.__name__
    return test


@on_each_bench
async def test_camera_before_start_and_after_stop_gives_no_picture(bench):
    await bench.shoot(3)
    await asyncio.sleep(3.0)
    assert bench.announced == []
    await bench.source.start(1.0, 0)
    await bench.shoot(3, first=3)
    await asyncio.sleep(3.0)
    assert len(bench.announced) == 3
    bench.source.stop()
    await asyncio.sleep(0.5)
    await bench.shoot(3, first=6)
    await asyncio.sleep(3.0)
    assert len(bench.announced) == 3


@on_each_bench
async def test_picture_is_dated_by_its_exposure(bench):
    await bench.source.start(0.7, 0)
    times = await bench.shoot(12, 0.73)
    await asyncio.sleep(3.0)
    assert len(bench.announced) == 12
    for picture, exposed_s in zip(bench.announced, times, strict=True):
        assert picture.taken_s == pytest.approx(exposed_s, abs=RIGHT_S)


@on_each_bench
async def test_pictures_come_in_order_and_can_be_fetched(bench):
    await bench.source.start(0.5, 0)
    await bench.shoot(5, 0.5)
    await asyncio.sleep(2.0)
    stamps = [picture.taken_s for picture in bench.announced]
    assert stamps == sorted(stamps)
    assert await bench.load() == [True] * 5
    names = [picture.name for picture in bench.announced]
    assert len(set(names)) == 5


@on_each_bench
async def test_count_of_pictures_is_kept(bench):
    for burst in range(2):
        await bench.source.start(0.5, 3)
        await bench.shoot(6, 0.5, first=6 * burst)
        await asyncio.sleep(2.0)
        assert len(bench.announced) == 3 * (burst + 1)
        bench.source.note_end()


@on_each_bench
async def test_interval_is_kept_by_a_camera_that_takes_more(bench):
    await bench.source.start(1.0, 0)
    await bench.shoot(40, 0.1)
    await asyncio.sleep(2.0)
    stamps = [picture.taken_s for picture in bench.announced]
    assert 4 <= len(stamps) <= 5
    steps = [b - a for a, b in itertools.pairwise(stamps)]
    assert all(0.7 <= step <= 1.4 for step in steps)


@on_each_bench
async def test_start_while_pictures_are_taken_restarts_them(bench):
    await bench.source.start(5.0, 0)
    await bench.shoot(2, 0.5)
    await bench.source.start(0.5, 0)
    await bench.shoot(4, 0.5, first=2)
    await asyncio.sleep(2.0)
    assert len(bench.announced) == 5


@on_each_bench
async def test_picture_that_cannot_be_fetched_is_lost_and_the_next_comes(bench):
    await bench.source.start(1.0, 0)
    await bench.shoot(1)
    await bench.hardware.spoil(1)
    await asyncio.sleep(1.0)
    await bench.shoot(1, first=2)
    await asyncio.sleep(8.0)
    good = await bench.load()
    assert sorted(good) == [False, True, True]


@on_each_bench
async def test_camera_that_vanishes_and_returns_continues(bench):
    await bench.source.start(1.0, 0)
    await bench.shoot(2)
    await asyncio.sleep(1.0)
    bench.hardware.vanish()
    await asyncio.sleep(20.0)
    before = len(bench.announced)
    assert before == 2
    bench.hardware.come_back()
    bench.source.uncertain()
    await asyncio.sleep(3.0)
    await bench.source.start(1.0, 0)
    await bench.shoot(3, first=5)
    await asyncio.sleep(3.0)
    assert len(bench.announced) == 5
    assert await bench.load() == [True] * 5


def test_picture_without_feedback_gets_no_neighbours_place(tmp_path):
    """At 5 pictures a second the next exposure is 0.2 s away, and 1.2 m at 6 m/s."""

    async def main():
        async with triggered_bench(tmp_path) as bench:
            hardware = bench.hardware
            say, lost = hardware.peer.send, 7

            def lossy(*messages, **how):
                if not any(getattr(message, "img_idx", 0) == lost for message in messages):
                    say(*messages, **how)

            hardware.peer.send = lossy
            later, loop = hardware.card.later, asyncio.get_running_loop()
            # the card takes 0.05 s longer than `camera.latency_s` states
            hardware.card.later = lambda *how: loop.call_later(0.05, later, *how)
            await bench.source.start(0.2, 0)
            times = await bench.shoot(15, 0.2)
            await asyncio.sleep(8.0)
            had = [p for p, good in zip(bench.announced, await bench.load(), strict=True) if good]
            assert len(had) == 14
            assert any("no CAMERA_FEEDBACK of its time" in line for line in bench.told)
            for picture in had:
                number = int("".join(filter(str.isdigit, Path(picture.name).stem)))
                assert picture.taken_s == pytest.approx(times[number], abs=RIGHT_S)

    run(main(), VirtualClock())
