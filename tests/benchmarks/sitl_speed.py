"""Speed of the simulator; prints a table.

    python -m tests.benchmarks.sitl_speed            everything, about two minutes
    python -m tests.benchmarks.sitl_speed --virtual  without sockets
    python -m tests.benchmarks.sitl_speed --sockets  sockets only

On virtual time: simulated seconds per second of one processor, in the wind, with twelve messages at
10 Hz (those of REQUEST_DATA_STREAM). The figure is the median of seven flights. Over sockets: the
speed-up that is kept by the clock on the wall, the median of three. A client in this process
receives and decodes all frames; the simulator is a process of its own. Each row has its target; the
exit status is 1 if one is missed.
"""

from __future__ import annotations

import gc
import statistics
import sys
import time
from collections.abc import Callable

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.scenario import Setup
from sitl.sockets.server import free_ports
from sitl.testing import Fleet
from tests.benchmarks.frame import cpu_ms, head, options_of, row
from tests.e2e.rig import started

RATE_HZ = 10
ROUNDS, SOCKET_ROUNDS = 7, 3
SOCKET_S = 8.0
STREAM_ALL = mav.MAV_DATA_STREAM_ALL


def virtual(vehicles: int, seconds: float) -> float:
    """Return the speed in flight, times real time, by the processor's time alone."""
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
    factor = 1e3 * seconds / cpu_ms(lambda: fleet.run(seconds))
    assert all(vehicle.truth.height_m > 1.0 for vehicle in fleet)
    assert len(fleet[0].receive()) > 12 * RATE_HZ * seconds * 0.8
    return factor


def over_sockets(vehicles: int, speedup: float) -> float:
    """Return the speed-up that is kept, by the vehicles' own clocks; the slowest of them."""
    port, http_port = free_ports(vehicles)
    arguments = ["sitl", "--home", "47.4,8.5,488,0", "--speedup", speedup, "--vehicles", vehicles]
    links = [
        mavutil.mavlink_connection(f"udpin:127.0.0.1:{port + 10 * i}") for i in range(vehicles)
    ]
    with started(*arguments, "--port", port, "--http-port", http_port):
        for link in links:
            link.wait_heartbeat(timeout=20)
            link.mav.request_data_stream_send(link.target_system, 1, STREAM_ALL, RATE_HZ, 1)
        heard: dict[int, list[tuple[float, int]]] = {}
        end_s = time.monotonic() + SOCKET_S
        while (now_s := time.monotonic()) < end_s:
            for i, link in enumerate(links):
                while (message := link.recv_msg()) is not None:
                    if message.get_type() == "ATTITUDE":
                        heard.setdefault(i, []).append((now_s, message.time_boot_ms))
            time.sleep(0.002)
    for link in links:
        link.close()
    return min(
        (times[-1][1] - times[0][1]) / 1000.0 / (times[-1][0] - times[0][0])
        for times in heard.values()
    )


def main() -> int:
    options = options_of(__doc__, virtual=False, sockets=False)
    # vehicles, measured quantity, repetitions, and the least target
    runs: list[tuple[str, int, Callable[[int, float], float], float, int, float]] = []
    if options.virtual or not options.sockets:
        runs += [("virtual time", 1, virtual, 120.0, ROUNDS, 500.0)]
        runs += [("virtual time", 20, virtual, 10.0, ROUNDS, 25.0)]
    if options.sockets or not options.virtual:
        runs += [("UDP sockets", 1, over_sockets, 50.0, SOCKET_ROUNDS, 49.0)]
        runs += [("UDP sockets", 8, over_sockets, 10.0, SOCKET_ROUNDS, 9.8)]
    print(head("times real time", "median", "least", "most", "target", ""))
    short = False
    for name, vehicles, measure, how, rounds, wanted in runs:
        found = [measure(vehicles, how) for _ in range(rounds)]
        middle = statistics.median(found)
        short |= middle < wanted
        figures = (f"{value:.1f}" for value in (middle, min(found), max(found), wanted))
        verdict = "holds" if middle >= wanted else "FALLS SHORT"
        print(row(f"{name}, {vehicles} x {RATE_HZ} Hz", *figures, verdict), flush=True)
    return int(short)


if __name__ == "__main__":
    sys.exit(main())
