"""Captures from real devices and streams: HTTP video, RTSP, a program and a V4L2 device."""

import asyncio
import contextlib
import io
import itertools
import os
import shutil
import sys
import threading
import time
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from PIL import Image

from missions.errors import LinkError
from tests.support.mavlink_peer import Peer
from tests.support.ports import free_port
from tests.support.running import by, in_real_time
from tests.unit.uavmap.aircraft.cameras.rtsp_server import RtspServer
from uavmap.aircraft.cameras.captures import PipeCapture, gstreamer_command, libcamera_command
from uavmap.aircraft.cameras.opening import Settings, opened_camera
from uavmap.aircraft.cameras.pose import Mount
from uavmap.aircraft.cameras.spec import parse_camera
from uavmap.aircraft.cameras.stream import Freshness, StreamSource, ThreadReader
from uavmap.base.image_files import decoded

SIZE_PX = (320, 240)
PATIENCE_S = 240.0
SETTINGS = Settings(SIZE_PX, 0.2, 0.0, Mount())


def jpeg(shade):
    out = io.BytesIO()
    Image.new("RGB", SIZE_PX, (shade, shade, shade)).save(out, "JPEG")
    return out.getvalue()


class MjpegHandler(BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        with contextlib.suppress(OSError):
            for number in range(100_000):
                data = jpeg(number % 200 + 20)
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode() + data + b"\r\n")
                if self.server.over.wait(0.04):
                    return

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def mjpeg(port=0):
    server = ThreadingHTTPServer(("127.0.0.1", port), MjpegHandler)
    server.over = threading.Event()
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.over.set()
        server.shutdown()
        server.server_close()
        thread.join()


async def pictures(source, count, interval_s=0.2):
    heard = asyncio.Queue()
    source.listen(heard.put_nowait)
    begin_s = asyncio.get_running_loop().time()
    await source.start(interval_s, count)
    found = []
    async with asyncio.timeout(PATIENCE_S):
        for _ in range(count):
            picture = await heard.get()
            assert decoded(await picture.load(), picture.name, SIZE_PX).shape == (240, 320, 3)
            assert begin_s - 0.1 <= picture.taken_s <= asyncio.get_running_loop().time()
            found.append(picture)
    return found


def on(text, body):
    async def nothing(url):
        raise LinkError(url)

    async def main():
        told = []
        session = Peer().session
        async with opened_camera(parse_camera(text), session, nothing, SETTINGS, told.append) as it:
            await body(it, told)

    asyncio.run(main())


async def three(source, told):
    await pictures(source, 3)


def test_http_video_that_ends_is_opened_again():
    async def body(source, told):
        first = await pictures(source, 4)
        steps = [b.taken_s - a.taken_s for a, b in itertools.pairwise(first)]
        assert all(step >= 0.1 for step in steps)
        server.close()
        async with asyncio.timeout(PATIENCE_S):
            while not any("it is opened again" in line for line in told):  # noqa: ASYNC110
                await asyncio.sleep(0.05)
        with mjpeg(port):
            await pictures(source, 2)

    with contextlib.ExitStack() as server:
        port = server.enter_context(mjpeg())
        on(f"http://127.0.0.1:{port}/video", body)


def test_rtsp_stream_gives_pictures():
    with RtspServer([jpeg(shade) for shade in range(20, 220, 4)]) as server:
        on(f"rtsp://127.0.0.1:{server.port}/main", three)


def test_gstreamer_pipeline_gives_pictures():
    if shutil.which("gst-launch-1.0") is None:
        pytest.skip("this machine has no gst-launch-1.0")
    wanted = "video/x-raw,width=320,height=240,framerate=20/1"
    on(f"gstreamer:videotestsrc is-live=true ! {wanted}", three)


def test_frames_queued_in_a_stall_are_dropped():
    """The network stalls for two seconds; then the pictures of 25 a second arrive at once."""
    watch = Freshness()
    taken_s = [n * 0.04 for n in range(250)]
    there_s = [7.0 + n * 0.002 if 5.0 <= t < 7.2 else t for n, t in enumerate(taken_s, -125)]
    fresh = [watch.fresh(t) for t in sorted(there_s)]
    late_s = [there - taken for there, taken in zip(sorted(there_s), taken_s, strict=True)]
    assert all(late < 0.25 for late, good in zip(late_s, fresh, strict=True) if good)
    assert sum(fresh) > 190


def test_v4l2_device_gives_pictures():
    if not os.path.exists("/dev/video0"):
        pytest.skip("this machine has no V4L2 device")
    on("v4l2:/dev/video0", three)


WRITER = """
import sys, time
data = bytes.fromhex(sys.argv[1])
for number in range(int(sys.argv[2])):
    sys.stdout.buffer.write(data[:100]); sys.stdout.flush(); time.sleep(0.01)
    sys.stdout.buffer.write(data[100:]); sys.stdout.flush(); time.sleep(0.03)
"""


@by(in_real_time)
async def test_program_that_writes_jpegs_is_run_again_when_it_ends():
    command = [sys.executable, "-c", WRITER, jpeg(90).hex(), "25"]
    told = []
    reader = ThreadReader(partial(PipeCapture, command, "a program"))
    source = StreamSource("a program", reader, 0.0, SIZE_PX, told.append)
    await source.begin()
    running = asyncio.create_task(source.run())
    await pictures(source, 8, 0.3)  # longer than one run of the program
    assert "a program: no more pictures come; it is opened again" in told
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running


@by(in_real_time)
async def test_stream_that_hangs_ends_nothing():
    """Its frames stop; the reader that waits for them ends as soon as it is closed."""
    command = [sys.executable, "-c", WRITER + "time.sleep(600)", jpeg(90).hex(), "40"]
    reader = ThreadReader(partial(PipeCapture, command, "a program"))
    source = StreamSource("a program", reader, 0.0, SIZE_PX, lambda text: None)
    await source.begin()
    running = asyncio.create_task(source.run())
    await pictures(source, 1, 0.1)
    running.cancel()
    begin_s = time.monotonic()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    assert time.monotonic() - begin_s < 10.0


# --- what cannot be opened -------------------------------------------------------------------
async def unused(source, told):
    raise AssertionError("it was opened")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("v4l2:/dev/video99", "v4l2:/dev/video99: cannot be opened; is it plugged in"),
        ("folder:/no/such/folder", "/no/such/folder: no such folder"),
        ("triggered:/no/such/folder", "/no/such/folder: no such folder"),
    ],
)
def test_missing_camera_is_a_link_error(text, reason):
    with pytest.raises(LinkError, match=reason):
        on(text, unused)


def test_url_without_a_server_is_a_link_error():
    with pytest.raises(LinkError, match="cannot be opened; does it play in VLC"):
        on(f"http://127.0.0.1:{free_port()}/video", unused)


def test_program_not_installed_is_a_link_error(monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    with pytest.raises(LinkError, match=r"needs the program gst-launch-1\.0, which is not"):
        on("gstreamer:videotestsrc", unused)
    with pytest.raises(LinkError, match="needs the program libcamera-vid"):
        on("libcamera", unused)


@by(in_real_time)
async def test_pictures_of_another_size_are_refused_before_the_flight():
    async def nothing(url):
        raise LinkError(url)

    other = Settings((640, 480), 1.0, 0.0, Mount())
    with mjpeg() as port:
        spec = parse_camera(f"http://127.0.0.1:{port}/video")
        with pytest.raises(LinkError, match=r"the picture is 320 x 240 px, the camera 640"):
            async with opened_camera(spec, Peer().session, nothing, other, print):
                raise AssertionError("it was opened")


def test_program_commands_have_size_and_rate():
    command = libcamera_command("1", (1280, 960), 0.5)
    assert command[1:3] == ["--camera", "1"]
    assert command[command.index("--width") + 1] == "1280"
    assert command[command.index("--framerate") + 1] == "6"
    assert gstreamer_command("v4l2src device='/dev/video 2' ! videoscale")[:6] == [
        "gst-launch-1.0", "-q", "v4l2src", "device=/dev/video 2", "!", "videoscale",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text",
    ["", "usb", "v4l2:video0", "folder:", "mavlink:1", "libcamera:x", "gstreamer: ", "/dev/"],
)
def test_text_that_names_no_camera_is_refused(text):
    with pytest.raises(LinkError, match="is not a camera; write mavlink, v4l2:/dev/video0"):
        parse_camera(text)
