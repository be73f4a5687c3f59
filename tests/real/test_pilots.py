"""A pilot takes an aircraft by hand and keeps it until it is given back."""

from __future__ import annotations

from tests.real.rig import Rig
from tests.real.scenario import scenario

HOLD_S = 6.0
SHORT_S = 2.5
"""Time for which a pilot keeps it in a mode in which the sticks hold no height, s."""


@scenario("pilot: each mode of the switch, in mid-path", near=True)
async def test_pilots_mode_is_never_changed_back(rig: Rig) -> None:
    one = rig.aircraft[0]
    run = await rig.fly("--auto-swap")
    await rig.in_search(run)
    one.hold_sticks(centred=True)  # with the throttle up it does not arm
    await rig.rest(2.0)
    taken: list[str] = []
    for mode in one.by_hand:
        if taken:
            await rig.in_search(run)
        before = len(one.pilot.modes)
        await one.set_mode(mode)
        await rig.until(lambda: one.pilot.mode == mode, mode, 5.0)  # noqa: B023
        await rig.rest(SHORT_S if mode in ("STABILIZE", "ALTITUDE") else HOLD_S)
        told = [name for _, name in one.pilot.modes[before:]]
        assert told[told.index(mode) :] == [mode], f"{mode} was taken back: {told}"
        taken.append(mode)
        await one.set_mode(one.ours)
    rig.row.detail = f"kept: {', '.join(taken)}"
    await rig.rest(5.0)
    await rig.comes_home(run)


def left_to_the_pilot(what: str, mode: str, code: int) -> object:
    @scenario(f"pilot {what}", near=True)
    async def flown(rig: Rig) -> None:
        run = await rig.fly("--auto-swap")
        await rig.in_search(run)
        await rig.aircraft[0].set_mode(mode)
        await rig.ends_well(run, code)
        assert run.has_line("uavmap resume")

    return flown


test_a_pilot_lands_it_beside_its_pad = left_to_the_pilot("lands it", "LAND", 4)
test_a_pilot_has_it_return = left_to_the_pilot("has it return", "RTL", 3)
