"""`uavmap fly --camera` as processes, against `uavmap sitl`."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
import urllib.request

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e import rig


class CardCamera(threading.Thread):
    def __init__(self, vehicle: tuple[str, int], folder) -> None:
        super().__init__()
        self._link = mavutil.mavlink_connection(
            f"udpout:{vehicle[0]}:{vehicle[1]}", source_system=254
        )
        self._folder = folder
        self.over = threading.Event()

    def run(self) -> None:
        asked_s = 0.0
        while not self.over.is_set():
            if time.monotonic() - asked_s > 1.0:
                asked_s = time.monotonic()
                self._link.mav.command_long_send(
                    1, 100, mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1.0, 0, 0, 0, 0, 0
                )
            message = self._link.recv_match(type="CAMERA_IMAGE_CAPTURED", timeout=0.05)
            if message is None:
                time.sleep(0.005)
                continue
            with contextlib.suppress(OSError), urllib.request.urlopen(message.file_url) as answer:
                hidden = self._folder / f".{message.image_index}.part"
                hidden.write_bytes(answer.read())
                hidden.rename(self._folder / f"DSC{message.image_index:05}.JPG")
        self._link.close()


def test_flight_judges_the_pictures_of_a_folder(tmp_path):
    """Until some are judged; whole flights are flown on virtual time."""
    card, folder = tmp_path / "card", tmp_path / "out"
    card.mkdir()
    with (
        rig.simulator("speck", speedup=4.0) as (url,),
        rig.Relay(int(url.rpartition(":")[2])) as relay,
        rig.started(
            *("fly", rig.mission("speck"), "--connect", relay.url, "--camera", f"folder:{card}"),
            *("--speedup", 4, "--out", folder, "--json"),
        ) as process,
    ):
        rig.wait_until(lambda: relay.vehicle is not None, "the aircraft")
        assert relay.vehicle is not None
        camera = CardCamera(relay.vehicle, card)
        camera.start()
        try:
            rig.wait_until(
                lambda: len(rig.events(folder, "frame_seen")) >= 3 or process.poll() is not None,
                "judged frames",
            )
        finally:
            camera.over.set()
            camera.join()
        assert process.poll() is None, process.communicate()
        for _ in range(2):
            process.send_signal(signal.SIGINT)
            time.sleep(0.2)


def test_faulty_camera_is_refused_in_a_line(tmp_path):
    cameras = ["--camera", "mavlink", "--camera", "mavlink"]
    connect = ["--connect", "udpin://127.0.0.1:14550"]
    done = rig.uavmap("fly", rig.mission("speck"), *connect, *cameras, "--out", tmp_path / "out")
    assert done.code == 2
    assert "1 vehicles, but 2 cameras; give --camera once a vehicle" in done.err
    assert not (tmp_path / "out").exists()
