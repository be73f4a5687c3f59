"""Signed links, a ground station beside the service, and the operator's keys, over sockets."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import socket
import subprocess
import time

from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e import rig
from uavmap.mavlink.links.signing import read_key

SPEEDUP = 20.0


def test_key_is_made_installed_and_used_beside_a_ground_station(tmp_path):
    key, folder = tmp_path / "key", tmp_path / "out"
    assert rig.uavmap("keys", "new", key).code == 0
    with rig.simulator("speck", speedup=SPEEDUP) as urls, station() as (port, ground):
        wrong = tmp_path / "wrong"
        rig.uavmap("keys", "new", wrong)
        installed = rig.uavmap("keys", "install", key, "--connect", urls[0], "--yes")
        assert (installed.code, installed.err) == (0, "")
        assert "signs with it" in installed.out
        speck = rig.mission("speck")
        refused = rig.uavmap(*rig.flying(speck, urls, tmp_path / "no", SPEEDUP, "--key", wrong))
        assert refused.code == 2
        assert "signed with another key" in refused.err
        forward = ("--forward", f"udpout://{rig.LOOPBACK}:{port}")
        words = rig.flying(speck, urls, folder, SPEEDUP, "--key", key, *forward)
        with rig.started(*words) as process:
            ground.wait_for("GLOBAL_POSITION_INT")
            assert ground.signed
            done = rig.ended(process)
        assert done.code == 0
        secret = read_key(key)
        for file in folder.iterdir():
            data = file.read_bytes()
            assert secret not in data
            assert secret.hex().encode() not in data
        removed = rig.uavmap("keys", "remove", key, "--connect", urls[0], "--yes")
        assert (removed.code, removed.err) == (0, "")


def test_ground_station_queries_the_vehicle_through_the_service(tmp_path):
    with rig.simulator("speck", speedup=SPEEDUP) as urls, station() as (port, ground):
        forward = ("--forward", f"udpout://{rig.LOOPBACK}:{port}")
        words = rig.flying(rig.mission("speck"), urls, tmp_path / "out", SPEEDUP, *forward)
        with rig.started(*words) as process:
            ground.wait_for("HEARTBEAT")
            ground.wait_for(
                "PARAM_VALUE", mav.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1)
            )
            assert rig.ended(process).code == 0


class Station:
    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self._codec.robust_parsing = True
        self._peer = None
        self.signed = False

    def wait_for(self, kind: str, ask=None) -> None:
        due_s = time.monotonic() + rig.PATIENCE_S
        while time.monotonic() < due_s:
            if ask is not None and self._peer is not None:
                self._link.sendto(ask.pack(self._codec), self._peer)
            with contextlib.suppress(TimeoutError):
                data, self._peer = self._link.recvfrom(65536)
                for message in self._codec.parse_buffer(data) or ():
                    self.signed = self.signed or bool(message.get_msgbuf()[2] & 1)
                    if message.get_type() == kind:
                        return
        raise AssertionError(f"no {kind}")


@contextlib.contextmanager
def station():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind((rig.LOOPBACK, 0))
        link.settimeout(0.2)
        yield link.getsockname()[1], Station(link)


# --- keys ----------------------------------------------------------------------------------------
def test_keys_at_a_terminal_pause_continue_and_recall(folder):
    """A real terminal and a real process: pressed keys become events.

    The map shows the cells that were not observed.
    """
    operator, ours = pty.openpty()
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        lines = ["fly", rig.mission("speck"), *rig.arguments_of(urls), "--speedup", SPEEDUP]
        process = subprocess.Popen(
            rig.command(*lines, "--auto-swap", "--out", folder),
            env=rig.environment(),
            stdin=ours,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            rig.wait_for(folder, "airborne")
            os.write(operator, b"p")
            rig.wait_for(folder, "paused")
            seen = len(rig.events(folder, "tracked"))
            rig.wait_until(
                lambda: len(rig.events(folder, "tracked")) > seen + 10, "ten seconds of holding"
            )
            assert not rig.events(folder, "recalled")
            os.write(operator, b"c")
            rig.wait_for(folder, "continued")
            os.write(operator, b"r")
            done = rig.ended(process)
        finally:
            process.kill()
            process.communicate()
            os.close(operator)
            os.close(ours)
    assert done.code == 3
    assert f"to continue: uavmap resume {folder}" in done.err
    assert re.search(r"p pause", done.err)
    kinds = [event["kind"] for event in rig.events(folder, "paused", "continued", "recalled")]
    assert kinds == ["paused", "continued", "recalled"]
    assert json.loads((folder / "summary.json").read_text())["cells_skipped"] == 0


def test_port_given_twice_is_refused_with_the_remedy(tmp_path):
    port, _ = rig.free_ports(1)
    url = f"udpin://{rig.LOOPBACK}:{port}"
    done = rig.uavmap(
        "fly", rig.mission("pair"), "--connect", url, "--connect", url, "--out", tmp_path / "x"
    )
    assert done.code == 2
    assert "?system=1" in done.err
