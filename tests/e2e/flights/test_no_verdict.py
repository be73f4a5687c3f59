"""A flight whose detector does not fit the ground ends without a verdict, and not as complete."""

from __future__ import annotations

import json
import re
from pathlib import Path

from tests.e2e import rig
from uavmap import open_results

SPECK = Path(rig.mission("speck")).read_text("utf-8")
EMPTY = re.sub(r"\[\[sim\.roi\]\].*", "", SPECK, flags=re.DOTALL)


def assert_no_verdict(done: rig.Finished, folder: Path, reason: str) -> None:
    assert done.code == 5, done.err
    assert done.summary["completed"] is False
    assert reason in done.summary["no_verdict"]
    assert f"uavmap: no verdict: {done.summary['no_verdict']}; check what it marks" in done.err
    assert "to continue" not in done.err
    report = (folder / "report.html").read_text("utf-8")
    assert "No verdict: no verdict: " in report
    assert reason in report
    assert (folder / "judged.jpg").is_file()
    assert "data:image/jpeg;base64," in report
    assert open_results(folder).no_verdict == done.summary["no_verdict"]
    values = json.loads((folder / "summary.json").read_text("utf-8"))
    assert values["finding"].startswith(f"no verdict: {done.summary['no_verdict']}; ")


def test_flight_over_real_ground_default_detector_sees_nothing_ends_without_a_verdict(tmp_path):
    """The links are real ones here, so the ground counts as real."""
    source, folder = tmp_path / "empty.toml", tmp_path / "out"
    source.write_text(re.sub(r"^dilations = .*$", "", EMPTY, flags=re.MULTILINE))
    with rig.simulator(str(source.with_suffix("")), speedup=20.0) as urls:
        done = rig.uavmap(*rig.flying(source, urls, folder, 20.0))
    assert_no_verdict(done, folder, "no region in the whole box, by the detector threshold")
    again = rig.uavmap("resume", folder, "--json")
    assert_no_verdict(again, folder, "no region in the whole box, by the detector threshold")
    told = rig.uavmap("resume", folder)
    assert re.search(r"mission completed\s*.\s*no verdict", told.out)


def test_flight_with_region_everywhere_ends_without_a_verdict(tmp_path):
    text = SPECK.replace("dilations = 4", "intensity = 254")
    flight = rig.flown_text(text, tmp_path, "--strategy", "swath")
    done, folder = flight.done, flight.folder
    assert_no_verdict(done, folder, "% of the ")
    assert done.err.count("as region: check whether it fits this ground") == 1
    (folder / "report.html").unlink()
    assert rig.uavmap("report", folder).code == 0  # from the journal, which agrees
    assert "No verdict: no verdict: the detector marked" in (folder / "report.html").read_text(
        "utf-8"
    )


def test_flight_in_the_simulator_that_sees_nothing_is_complete(tmp_path):
    """There the default detector fits."""
    done = rig.flown_text(EMPTY, tmp_path).done
    assert done.code == 0, done.err
    assert (done.summary["completed"], done.summary["no_verdict"]) == (True, None)
    assert "check whether it fits" not in done.err
