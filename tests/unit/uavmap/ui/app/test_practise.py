"""A flight that a page has started does not depend on the page."""

from __future__ import annotations

import asyncio
import shutil
import socket
from pathlib import Path

from tests.e2e import rig
from uavmap.ui.app.flights import fly_in, free_ports
from uavmap.ui.app.jobs import Jobs
from uavmap.ui.app.visitor import App
from uavmap.ui.app.workspace import Workspace


def test_flight_and_simulator_continue_when_the_page_ends(tmp_path: Path) -> None:
    shutil.copy(rig.mission("speck"), tmp_path / "speck.toml")
    app = App(Workspace(tmp_path), None)
    ports = ["--port", str(free_ports(1)), "--http-port", str(free_ports(1, socket.SOCK_STREAM))]
    simulator = app.jobs.begin(["sitl", "--mission", "speck.toml", "--speedup", "5", *ports])
    flight = ["fly", "speck.toml", "--speedup", "5", "--yes", "--out", "flown"]

    async def page() -> None:
        flying = asyncio.create_task(fly_in(app, simulator, flight, 1))
        while len(app.jobs.all) < 2:
            assert not flying.done(), simulator.lines()
            await asyncio.sleep(0.05)

    asyncio.run(page())
    job = app.jobs.all[1]
    try:
        rig.wait_until(lambda: (tmp_path / "flown").exists() or not job.runs, "the flight")
        assert job.runs, job.lines()
        assert simulator.runs
    finally:
        for each in (job, simulator):
            each.interrupt()
            each.process.wait()


def test_page_of_a_command_is_not_the_map_for_a_gis(tmp_path: Path) -> None:
    jobs = Jobs(tmp_path)
    job = jobs.begin(["watch", "nothing"])
    job.process.wait()
    job.log.write_text(
        "live page: http://127.0.0.1:8470/?token=abc\n"
        "live page without buttons: http://127.0.0.1:8470/?token=ghi\n"
        "map for a GIS: http://127.0.0.1:8470/map.geojson?token=def\n" + "a line\n" * 20_000
    )
    assert job.page(steers=True) is None  # it has ended

    class Runs:
        def poll(self) -> None:
            return None

    job.process = Runs()  # type: ignore[assignment]
    assert job.page(steers=True) == "http://127.0.0.1:8470/?token=abc"
    assert job.page(steers=False) == "http://127.0.0.1:8470/?token=ghi"
