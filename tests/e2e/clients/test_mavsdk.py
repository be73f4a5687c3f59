"""The simulated vehicle is flown by MAVSDK as it is on PyPI."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.rig import PATIENCE_S, environment, simulator

CLIENT = Path(__file__).with_name("mavsdk_client.py")


def test_mavsdk_flies_there_and_back():
    with simulator("speck", speedup=12.0) as (url,):
        done = subprocess.run(
            [sys.executable, CLIENT, url],
            env=environment(),
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    seen = json.loads(done.stdout.splitlines()[-1])
    assert seen["armed"] is True
    assert seen["in_air"] is True
    assert seen["away_m"] == pytest.approx(15.0, abs=2.5)
    assert seen["height_m"] == pytest.approx(10.0, abs=1.5)
    assert seen["back_m"] == pytest.approx(0.0, abs=1.5)
    assert seen["landed_height_m"] == pytest.approx(0.0, abs=0.5)
