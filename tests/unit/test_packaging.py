"""The units for a computer on board: systemd and our command line accept them."""

from __future__ import annotations

import configparser
import json
import re
import runpy
import shlex
import shutil
import subprocess
import tomllib
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from tests.unit.test_pages import ROOT, command_lines
from uavmap.mavlink.links.urls import parse_url
from uavmap.ui.cli import AIRCRAFT_DOWN, INCOMPLETE, parser

FOLDER = ROOT / "packaging" / "systemd"
UNITS = sorted(FOLDER.glob("*.service"))
PROGRAM = "/opt/uavmap/bin/uavmap"
PAGE = ROOT / "docs" / "how-to" / "onboard.md"


@pytest.fixture(params=UNITS, ids=lambda unit: unit.stem)
def unit(request: pytest.FixtureRequest) -> Path:
    assert isinstance(request.param, Path)
    return request.param


def read(unit: Path) -> configparser.ConfigParser:
    values = configparser.ConfigParser(interpolation=None, strict=True)
    values.optionxform = str  # type: ignore[assignment,method-assign]
    values.read_string(unit.read_text("utf-8"))
    return values


def url() -> str:
    (line,) = (
        line for line in (FOLDER / "link.env").read_text("utf-8").splitlines()
        if line.startswith("UAVMAP_URL=")
    )  # fmt: skip
    return line.partition("=")[2]


def command(unit: Path) -> list[str]:
    line = read(unit)["Service"]["ExecStart"].replace("${UAVMAP_URL}", url())
    program, *arguments = shlex.split(line)
    assert program == PROGRAM
    return arguments


def test_units_are_fly_recall_and_resume():
    assert [unit.stem for unit in UNITS] == ["uavmap-fly", "uavmap-recall", "uavmap-resume"]


def test_the_command_of_a_unit_is_understood(unit):
    options = parser().parse_args(command(unit))
    assert options.command in ("fly", "resume")
    assert [parse_url(text).port for text in options.connect] == [921600]
    assert (options.out if options.command == "fly" else options.folder) == "/var/lib/uavmap/flight"


def test_unit_that_may_take_off_is_never_started_by_itself(unit):
    values, options = read(unit), parser().parse_args(command(unit))
    stays_down = options.command == "resume" and options.recall
    assert ("Install" in values) == stays_down
    assert values["Service"]["Restart"] == ("on-failure" if stays_down else "no")
    if not stays_down:
        assert values["Unit"]["OnFailure"] == "uavmap-recall.service"
        assert "uavmap-recall.service" in values["Unit"]["Conflicts"].split()


def test_an_orderly_end_is_no_failure(unit):
    codes = read(unit)["Service"]["SuccessExitStatus"].split()
    assert list(map(int, codes)) == [INCOMPLETE, AIRCRAFT_DOWN]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_takes_the_units(tmp_path):
    for unit in UNITS:
        text = unit.read_text("utf-8").replace(PROGRAM, "/bin/true")
        (tmp_path / unit.name).write_text(text, "utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", *(tmp_path / unit.name for unit in UNITS)],
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_the_page_names_each_file_and_its_commands_are_held_by_the_test_of_the_pages():
    text = PAGE.read_text("utf-8")
    assert all(file.name in text for file in FOLDER.iterdir())
    lines = list(command_lines(PAGE))
    assert any(line.startswith("uavmap fly") for line in lines)
    assert any("--recall" in line for line in lines)


def test_wheel_has_a_bill_of_the_pinned_versions_of_all_that_it_needs(tmp_path):
    builder = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with zipfile.ZipFile(next(builder)) as wheel:
        (name,) = (n for n in wheel.namelist() if "/sboms/" in n)
        bill = json.loads(wheel.read(name))
    assert name.endswith(".dist-info/sboms/uavmap.cdx.json")
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    listed = bill["components"]
    pinned = re.findall(r"(?m)^([\w.-]+==[^\s;]+)", (ROOT / "requirements.txt").read_text("utf-8"))
    assert {f"{one['name']}=={one['version']}" for one in listed} <= set(pinned)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    needed = {text.partition(">=")[0] for text in project["dependencies"]}
    assert needed <= {one["name"] for one in listed}
    refs = [one["bom-ref"] for one in listed]
    assert bill["dependencies"] == [{"ref": "uavmap", "dependsOn": refs}]
    assert len(set(refs)) == len(refs)


def test_bill_states_the_condition_of_a_version():
    bill = runpy.run_path(str(ROOT / "packaging" / "sbom.py"))["bill"]
    lines = [
        "numpy==2.4.6 ; python_full_version < '3.12' \\",
        "    --hash=sha256:0",
        "rich==15.0.0",
    ]
    old, rich = bill(lines)["components"]
    assert (old["purl"], old["description"]) == (
        "pkg:pypi/numpy@2.4.6", "if python_full_version < '3.12'",
    )  # fmt: skip
    assert "description" not in rich
