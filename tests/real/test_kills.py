"""Kill -9 of either process in each phase, Ctrl-C once and twice, and a link that is gone."""

from __future__ import annotations

from tests.real.rig import Rig, Run
from tests.real.scenario import scenario

LEFT_S = 400.0
"""Time within which aircraft without a mission are at home, s."""


async def reached(rig: Rig, phase: str) -> Run:
    run = await rig.fly("--auto-swap")
    if phase == "climb":
        await rig.climbing(run)
    elif phase == "exploration":
        await rig.exploring(run)
    else:
        await rig.in_search(run)
        if phase == "descent":
            await rig.descending(run)
    return run


def killed_and_resumed(phase: str) -> object:
    @scenario(f"kill -9 of the mission in its {phase}, resumed", near=True)
    async def flown(rig: Rig) -> None:
        run = await reached(rig, phase)
        await run.kill()
        await rig.rest(2.0)  # and it takes some seconds to start: after 20 they are brought home
        again = await rig.resume()
        if phase != "descent":
            await rig.in_search(again)
            await rig.rest(10.0)
            again.interrupt()
        # resumed in its descent it continues the mission, perhaps to its end
        await rig.ends_well(again, *((0, 3) if phase == "descent" else (3,)), within_s=900.0)

    return flown


def killed_and_left(phase: str) -> object:
    @scenario(f"kill -9 of the mission in its {phase}, left alone", near=True)
    async def flown(rig: Rig) -> None:
        run = await reached(rig, phase)
        await run.kill()
        await rig.all_down(LEFT_S)
        await rig.until(lambda: not rig.aircraft_process_lives, "its process is over", 120.0)
        away_m = rig.referee.judge.from_pad_m(1)
        again = await rig.resume("--recall")
        await rig.ends_well(again, 3)
        rig.row.detail = f"landed {away_m:.1f} m from its pad"

    return flown


test_killed_in_search_and_resumed = killed_and_resumed("search")
test_killed_in_exploration_and_resumed = killed_and_resumed("exploration")
test_killed_in_climb_and_resumed = killed_and_resumed("climb")
test_killed_in_descent_and_resumed = killed_and_resumed("descent")
test_killed_in_search_and_left = killed_and_left("search")
test_killed_in_exploration_and_left = killed_and_left("exploration")
test_killed_in_climb_and_left = killed_and_left("climb")
test_killed_in_descent_and_left = killed_and_left("descent")


@scenario("kill -9 of the aircraft's process", near=True)
async def test_aircraft_process_killed_comes_home(rig: Rig) -> None:
    run = await reached(rig, "search")
    rig.kill_aircraft_process()
    await rig.rest(30.0)
    await rig.comes_home(run)


@scenario("kill -9 of both processes, resumed", near=True)
async def test_both_processes_killed_and_resumed_come_home(rig: Rig) -> None:
    run = await reached(rig, "search")
    rig.kill_aircraft_process()
    await run.kill()
    await rig.rest(15.0)
    again = await rig.resume()
    await rig.rest(30.0)
    await rig.comes_home(again)


@scenario("Ctrl-C once", near=True)
async def test_control_c_once_comes_home(rig: Rig) -> None:
    run = await reached(rig, "search")
    await rig.comes_home(run)


@scenario("Ctrl-C twice", near=True)
async def test_control_c_twice_and_resumed_comes_home(rig: Rig) -> None:
    run = await reached(rig, "search")
    run.interrupt()
    await rig.rest(3.0)
    run.interrupt()
    code = await rig.end_of(run, 100.0)
    assert code == 4, run.lines[-3:]
    assert rig.referee.judge.in_the_air, "it waited until it was down, and said exit 4"
    await rig.all_down()
    assert rig.referee.judge.all_at_home
    again = await rig.resume("--recall")
    await rig.ends_well(again, 3)


@scenario("link gone for 40 s", near=True)
async def test_link_gone_and_back_comes_home(rig: Rig) -> None:
    run = await reached(rig, "exploration")
    for relay in rig.relays:
        relay.silent = True
    await rig.rest(40.0)
    for relay in rig.relays:
        relay.silent = False
    await rig.rest(40.0)
    await rig.comes_home(run)
