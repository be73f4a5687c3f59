"""`uavmap doctor` and a dry run as a user types them, against a simulator on sockets."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import pytest

from tests.e2e.rig import arguments_of, mission, simulator, uavmap

SPEEDUP = 20.0


@pytest.fixture(scope="module")
def urls() -> Iterator[list[str]]:
    with simulator("speck", speedup=SPEEDUP, vehicles=2, autopilot="px4") as urls:
        yield urls


def test_installation_is_checked_without_a_vehicle(tmp_path):
    done = uavmap("doctor", "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    found = {finding["what"]: finding for finding in done.summary["findings"]}
    assert done.summary["could_fly"]
    assert {"Python", "packages", "planning", "disk", "picture formats"} <= set(found)
    assert "ms late at worst" in found["event loop"]["found"]
    assert all(finding["vehicle"] is None for finding in found.values())


def test_vehicle_is_checked_for_a_mission(urls, tmp_path):
    connect = [*arguments_of(urls[:1]), "--speedup", SPEEDUP]
    done = uavmap("doctor", mission("speck"), *connect, "--out", tmp_path, "--json")
    assert done.code == 0, f"{done.err}{done.out}"
    findings = done.summary["findings"]
    assert "ms to judge one" in next(f["found"] for f in findings if f["what"] == "frames")
    levels = {f["what"]: f["level"] for f in findings if f["vehicle"] == 1}
    assert levels["GPS"] == levels["camera"] == levels["NAV_RCL_ACT"] == "ok"
    assert levels["COM_LOW_BAT_ACT"] == "warn"
    assert cv2.imread(str(tmp_path / "test-picture-1.png")).shape == (240, 320, 3)


def test_dry_run_arms_nothing_and_leaves_nothing_to_resume(urls, folder):
    connect = [*arguments_of(urls), "--speedup", SPEEDUP]
    done = uavmap("fly", mission("speck"), *connect, "--dry-run", "--out", folder)
    assert done.code == 0, done.err
    assert "uavmap: a dry run: nothing was armed; the mission could be flown" in done.err
    assert "RTL_RETURN_ALT=18" in done.err
    assert sorted(path.name for path in folder.iterdir()) == [
        "test-picture-1.png",
        "test-picture-2.png",
    ]


def test_faulty_input_is_refused_in_a_line(tmp_path):
    done = uavmap("doctor", "--connect", "carrier-pigeon://1", cwd=tmp_path)
    assert done.code == 2
    several = arguments_of(["udpin://127.0.0.1:1", "udpin://127.0.0.1:2"])
    done = uavmap("doctor", mission("speck"), *several, cwd=tmp_path)
    assert done.code == 2
    assert "1 vehicles, but 2 connection URLs" in done.err
