from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def run_pytest(folder, text, *options, name="test_theirs.py"):
    (folder / name).write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    only_ours = ["-p", "sitl.pytest_plugin", "-p", "no:cacheprovider", "--strict-markers"]
    return subprocess.run(
        [sys.executable, "-m", "pytest", *only_ours, "-q", "-W", "error", *options],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )


def outcome(done):
    return done.stdout.splitlines()[-1] + done.stderr


def test_examples_of_the_documentation_pass(tmp_path):
    page = (ROOT / "docs" / "how-to" / "test-mavlink.md").read_text("utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    text = "\n".join(block for block in blocks if "def test_" in block or "import" in block)
    tests = text.count("def test_")
    assert tests >= 5
    done = run_pytest(tmp_path, text)
    assert f"{tests} passed" in outcome(done), done.stdout


def test_heavy_modules_are_imported_only_with_a_vehicle(tmp_path):
    done = run_pytest(
        tmp_path,
        """
import sys
HEAVY = ("numpy", "cv2", "pymavlink.dialects", "shapely", "pyproj", "sitl.vehicle")
def loaded():
    return [name for name in HEAVY if name in sys.modules]
def test_before():
    assert loaded() == []
def test_with(sitl):
    assert sitl.t_s == 0.0
    assert loaded() == list(HEAVY)
""",
    )
    assert "2 passed" in outcome(done), done.stdout


def test_options_and_markers_set_up_the_vehicle(tmp_path):
    done = run_pytest(
        tmp_path,
        """
import pytest
def test_options(sitl, sitl_fleet):
    assert (sitl.fleet.setup.seed, sitl.fleet.setup.speedup) == (5, 3.0)
    assert len(sitl.fleet) == 2
    assert [v.system_id for v in sitl_fleet(3)] == [1, 2, 3]
    assert sitl.truth.position.lat_deg == pytest.approx(10.0)
    assert sitl.truth.yaw_rad == pytest.approx(1.5708, abs=1e-4)
@pytest.mark.sitl(seed=6, home=(20.0, 30.0))
class TestMarked:
    def test_class(self, sitl):
        assert sitl.fleet.setup.seed == 6
        assert sitl.truth.position.lat_deg == pytest.approx(20.0)
    @pytest.mark.sitl(seed=7, vehicles=1)
    def test_function(self, sitl, sitl_fleet):
        assert sitl.fleet.setup.seed == 7
        assert len(sitl.fleet) == 1
        assert sitl_fleet(seed=8).setup.seed == 8
""",
        *("--sitl-seed", "5", "--sitl-speedup", "3", "--sitl-vehicles", "2"),
        *("--sitl-home", "10,20,30,90", "--sitl-autopilot", "ardupilot"),
    )
    assert "3 passed" in outcome(done), done.stdout


WRONG = {
    "autopilot='inav'": "there is ardupilot",
    "vehicles=0": "vehicles: 0",
    "vehicles=3, places=[None]": "3 have 1 places",
    "speedup=0": "speedup: 0",
    "seed=-1": "seed: -1",
    "home='Zurich'": "LAT,LON,AMSL,YAW",
    "home=(95, 0)": "latitude is",
    "colour='red'": "'colour'",
    "world=['nowhere.geojson']": "nowhere.geojson: No such file",
    "wind_speed_m_s=99": "wind: 99",
    "gust_m_s=99": "gusts: 99",
    "battery_wh=0": "battery_wh and",
    "3": "takes keywords",
}


def test_a_setup_that_is_none_is_an_error_with_a_reason(tmp_path):
    tests = [
        f"@pytest.mark.sitl({marker})\ndef test_{i}(sitl): pass\n" for i, marker in enumerate(WRONG)
    ]
    done = run_pytest(tmp_path, "import pytest\n" + "\n".join(tests), "--tb=short")
    assert f"{len(WRONG)} errors" in outcome(done), done.stdout
    sections = re.split(r"_+ ERROR at setup of test_\d+ _+\n", done.stdout)[1:]
    for message, section in zip(WRONG.values(), sections, strict=True):
        (last, *_) = reversed([line for line in section.splitlines() if line.startswith("E ")])
        assert message in last
