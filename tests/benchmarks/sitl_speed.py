"""How fast the simulator is; prints a table.

    python tests/benchmarks/sitl_speed.py            everything, about two minutes
    python tests/benchmarks/sitl_speed.py --virtual  without sockets
    python tests/benchmarks/sitl_speed.py --sockets  sockets only

On virtual time: simulated seconds per second of one processor, the median of seven flights in the
wind with twelve messages at 10 Hz (what REQUEST_DATA_STREAM asks for). Over sockets: the speed-up
that is held, by the clock on the wall, while a client in this process receives and decodes
everything, the simulator being a process of its own; the median of three. Each row has its target;
the exit status is 1 when one is missed.
"""

from __future__ import annotations

import argparse
import gc
import signal
import statistics
import subprocess
import sys
import time

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.scenario import Setup
from sitl.sockets.background import free_ports
from sitl.testing import Fleet

RATE_HZ = 10
ROUNDS, SOCKET_ROUNDS = 7, 3
SOCKET_S = 8.0
STREAM_ALL = mav.MAV_DATA_STREAM_ALL


def virtual(vehicles: int, seconds: float) -> float:
    """Times real time, in flight, by the processor's time: other programs do not count."""
    setup = Setup(vehicles=vehicles, wind_speed_m_s=4.0, wind_from_deg=200.0, gust_m_s=1.0)
    fleet = Fleet(setup)
    fleet.run(6.0)
    for vehicle in fleet:
        vehicle.send(
            mav.MAVLink_request_data_stream_message(vehicle.system_id, 1, STREAM_ALL, RATE_HZ, 1)
        )
        assert vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, 4) == 0
        assert vehicle.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
        assert vehicle.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 30) == 0
        vehicle.receive_bytes()
    gc.collect()
    start_s = time.process_time()
    fleet.run(seconds)
    factor = seconds / (time.process_time() - start_s)
    assert all(vehicle.truth.height_m > 1.0 for vehicle in fleet)
    assert len(fleet[0].receive()) > 12 * RATE_HZ * seconds * 0.8
    return factor


def over_sockets(vehicles: int, speedup: float) -> float:
    """The speed-up that is held, by the vehicles' own clocks; the slowest of them."""
    port, http_port = free_ports(vehicles)
    arguments = ["sitl", "--home", "47.4,8.5,488,0", "--speedup", speedup, "--vehicles", vehicles]
    arguments += ["--port", port, "--http-port", http_port]
    links = [
        mavutil.mavlink_connection(f"udpin:127.0.0.1:{port + 10 * i}") for i in range(vehicles)
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "uavmap", *map(str, arguments)], stdout=subprocess.DEVNULL
    )
    try:
        for link in links:
            link.wait_heartbeat(timeout=20)
            link.mav.request_data_stream_send(link.target_system, 1, STREAM_ALL, RATE_HZ, 1)
        first: dict[int, tuple[float, int]] = {}
        last: dict[int, tuple[float, int]] = {}
        end_s = time.monotonic() + SOCKET_S
        while (now_s := time.monotonic()) < end_s:
            for i, link in enumerate(links):
                while (message := link.recv_msg()) is not None:
                    if message.get_type() == "ATTITUDE":
                        first.setdefault(i, (now_s, message.time_boot_ms))
                        last[i] = (now_s, message.time_boot_ms)
            time.sleep(0.002)
        return min(
            (last[i][1] - first[i][1]) / 1000.0 / (last[i][0] - first[i][0])
            for i in range(vehicles)
        )
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(10)
        for link in links:
            link.close()


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--virtual", action="store_true", help="virtual time only")
    parser.add_argument("--sockets", action="store_true", help="sockets only")
    options = parser.parse_args()
    both = options.virtual == options.sockets
    rows: list[tuple[str, float, float, float, float]] = []
    if both or options.virtual:
        for vehicles, seconds, wanted in ((1, 120.0, 500.0), (20, 10.0, 25.0)):
            found = sorted(virtual(vehicles, seconds) for _ in range(ROUNDS))
            name = f"virtual time, {vehicles} vehicle{'s' * (vehicles > 1)}, {RATE_HZ} Hz"
            rows.append((name, statistics.median(found), found[0], found[-1], wanted))
    if both or options.sockets:
        for vehicles, speedup in ((1, 50.0), (8, 10.0)):
            found = sorted(over_sockets(vehicles, speedup) for _ in range(SOCKET_ROUNDS))
            name = f"UDP sockets, {vehicles} vehicle{'s' * (vehicles > 1)}, {RATE_HZ} Hz"
            rows.append((name, statistics.median(found), found[0], found[-1], 0.98 * speedup))
    print(f"{'times real time':40} {'median':>8} {'least':>8} {'most':>8} {'target':>8}")
    for name, median, least, most, wanted in rows:
        verdict = "holds" if median >= wanted else "FALLS SHORT"
        print(f"{name:40} {median:8.1f} {least:8.1f} {most:8.1f} {wanted:8.1f}  {verdict}")
    return 0 if all(median >= wanted for _, median, _, _, wanted in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
