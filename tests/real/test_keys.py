"""Signing: a key is installed, used, refused if it is wrong, and removed."""

from __future__ import annotations

from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.real.rig import Rig
from tests.real.scenario import scenario


def signed(rig: Rig) -> bool:
    frame = bytes(rig.aircraft[0].pilot.latest["HEARTBEAT"].get_msgbuf())
    return bool(frame[2] & mav.MAVLINK_IFLAG_SIGNED)


async def done(rig: Rig, *words: object) -> tuple[int, str]:
    run = await rig.uavmap(*words)
    return await rig.end_of(run, 200.0), "\n".join(run.lines)


async def new_key(rig: Rig, name: str) -> Path:
    path = rig.folder / name
    assert (await done(rig, "keys", "new", path))[0] == 0
    return path


@scenario("keys: install, fly, wrong key, remove", only="ardupilot", near=True)
async def test_key_is_installed_used_and_removed(rig: Rig) -> None:
    link = rig.links[:2]
    key, other = await new_key(rig, "owner.key"), await new_key(rig, "other.key")
    code, said = await done(rig, "keys", "install", key, *link, "--yes")
    assert code == 0, said
    await rig.rest(3.0)
    assert signed(rig)
    secret = bytes.fromhex(key.read_text("ascii").strip())
    rig.relays[0].sign_with(secret)
    code, said = await done(rig, "doctor", *rig.links, "--key", other)
    assert code != 0
    assert "sign" in said, f"a wrong key is not named: {said}"
    run = await rig.fly("--auto-swap", "--key", key)
    await rig.in_search(run)
    await rig.called_off(run)
    code, said = await done(rig, "keys", "remove", key, *link, "--yes")
    assert code == 0, said
    await rig.rest(3.0)
    assert not signed(rig)
    code, said = await done(rig, "doctor", *rig.links)
    assert code == 0, f"it hears no one after its key was removed: {said}"
    await rig.ends_well(run, 3)
