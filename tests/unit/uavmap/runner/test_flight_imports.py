"""What a real flight loads."""

from __future__ import annotations

import subprocess
import sys

from tests.e2e.rig import environment
from uavmap.mavlink.vehicle_view import SIMULATOR_IDENTITY


def test_a_real_flight_imports_nothing_of_the_simulator() -> None:
    code = (
        "import sys, uavmap.ui.cli, uavmap.runner.flight\n"
        "print([name for name in sys.modules if name.split('.')[0] == 'sitl'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment(), capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_the_identity_by_which_the_simulator_is_known_is_its_own() -> None:
    from sitl.mavlink.telemetry import IDENTITY  # noqa: PLC0415 - not above the other test

    assert IDENTITY == SIMULATOR_IDENTITY
