"""A flight whose detector does not fit the ground ends without a verdict, and not as complete."""

from __future__ import annotations

import json
import re
from pathlib import Path

from tests.e2e.rig import MISSIONS, Finished, flying, simulator, uavmap
from uavmap import open_results

SPECK = (MISSIONS / "speck.toml").read_text("utf-8")


def assert_no_verdict(done: Finished, folder: Path, reason: str) -> None:
    assert done.code == 5, done.err
    assert done.summary["completed"] is False
    assert reason in done.summary["no_verdict"]
    assert f"uavmap: no verdict: {done.summary['no_verdict']}; look at what it marks" in done.err
    assert "to go on" not in done.err
    report = (folder / "report.html").read_text("utf-8")
    assert "No verdict: no verdict: " in report
    assert reason in report
    assert (folder / "judged.jpg").is_file()
    assert "data:image/jpeg;base64," in report
    assert open_results(folder).no_verdict == done.summary["no_verdict"]
    values = json.loads((folder / "summary.json").read_text("utf-8"))
    assert values["finding"].startswith(f"no verdict: {done.summary['no_verdict']}; ")


def test_flight_over_real_ground_default_detector_sees_nothing_ends_without_a_verdict(
    tmp_path: Path,
) -> None:
    """Links are real ones here, and so the ground is taken to be."""
    empty = re.sub(r"\[\[sim\.roi\]\].*", "", SPECK, flags=re.DOTALL)
    source, folder = tmp_path / "empty.toml", tmp_path / "out"
    source.write_text(re.sub(r"^dilations = .*$", "", empty, flags=re.MULTILINE))
    with simulator(str(source.with_suffix("")), speedup=20.0) as urls:
        done = uavmap(*flying(source, urls, folder, 20.0))
    assert_no_verdict(done, folder, "no region in the whole box, by the detector threshold")
    again = uavmap("resume", folder, "--json")
    assert_no_verdict(again, folder, "no region in the whole box, by the detector threshold")
    told = uavmap("resume", folder)
    assert re.search(r"mission completed\s*.\s*no verdict", told.out)


def test_flight_whose_detector_takes_all_for_region_ends_without_a_verdict(tmp_path: Path) -> None:
    source, folder = tmp_path / "all.toml", tmp_path / "out"
    source.write_text(SPECK.replace("dilations = 4", "intensity = 254"))
    done = uavmap("fly", source, "--sim", "--json", "--out", folder)
    assert_no_verdict(done, folder, "% of the ")
    assert "for region: check whether it fits this ground" in done.err
    (folder / "report.html").unlink()
    assert uavmap("report", folder).code == 0  # from the journal, which says the same
    assert "No verdict: no verdict: the detector took" in (folder / "report.html").read_text(
        "utf-8"
    )


def test_flight_in_the_simulator_that_sees_nothing_is_complete(tmp_path: Path) -> None:
    """There the default detector is the right one."""
    source = tmp_path / "empty.toml"
    source.write_text(re.sub(r"\[\[sim\.roi\]\].*", "", SPECK, flags=re.DOTALL))
    done = uavmap("fly", source, "--sim", "--json", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    assert done.summary["completed"] is True
    assert done.summary["no_verdict"] is None
