"""The pytest plugin: fixtures `sitl` (one vehicle) and `sitl_fleet` (several), marker `sitl`.

The simulator is imported when a test asks for a vehicle, not before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from sitl.testing import Fleet, Vehicle

_OPTIONS: tuple[tuple[str, type, str], ...] = (
    ("autopilot", str, "flavour of the simulated vehicles: ardupilot or px4"),
    ("vehicles", int, "vehicles in a fleet"),
    ("home", str, "start of the vehicles: LAT,LON,AMSL,YAW"),
    ("speedup", float, "times real time, on sockets"),
    ("seed", int, "of wind, positioning errors and pictures"),
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add options that hold for every simulated vehicle; a marker overrides them."""
    group = parser.getgroup("sitl", "simulated MAVLink vehicles")
    for name, kind, text in _OPTIONS:
        group.addoption(f"--sitl-{name}", type=kind, default=None, help=text)


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line(
        "markers",
        "sitl(autopilot, vehicles, home, speedup, seed, ...): the simulated vehicles of a test, "
        "by the fields of sitl.scenario.Setup",
    )


def _chosen(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the options, then the markers of module, class and function, the nearest last."""
    values = {name: request.config.getoption(f"--sitl-{name}") for name, _, _ in _OPTIONS}
    chosen = {name: value for name, value in values.items() if value is not None}
    for marker in reversed(list(request.node.iter_markers("sitl"))):
        if marker.args:
            raise pytest.UsageError("pytest.mark.sitl takes keywords, such as vehicles=3")
        chosen.update(marker.kwargs)
    return chosen


@pytest.fixture
def sitl_fleet(request: pytest.FixtureRequest) -> Iterator[Callable[..., Fleet]]:
    """Make fleets: `sitl_fleet(3)`, `sitl_fleet(3, seed=7)`. All end with the test."""
    # here and not above: every pytest run of the installation imports this module
    from missions.errors import UavmapError  # noqa: PLC0415
    from sitl.scenario import Setup  # noqa: PLC0415
    from sitl.testing import Fleet  # noqa: PLC0415

    fleets: list[Fleet] = []

    def make(vehicles: int | None = None, **changes: Any) -> Fleet:
        chosen = {**_chosen(request), **changes}
        if vehicles is not None:
            chosen["vehicles"] = vehicles
        try:
            fleets.append(Fleet(Setup(**chosen)))
        except (TypeError, UavmapError) as error:
            raise pytest.UsageError(f"sitl: {error}") from error
        return fleets[-1]

    yield make
    for fleet in fleets:
        fleet.close()


@pytest.fixture
def sitl(sitl_fleet: Callable[..., Fleet]) -> Vehicle:
    """Return a simulated vehicle, on the ground and just switched on."""
    vehicle: Vehicle = sitl_fleet()[0]
    return vehicle
