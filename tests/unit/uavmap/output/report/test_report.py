"""report.html: its content, its safety against scripts and links, and its creation."""

import errno
import json
import os
import re
from dataclasses import replace

import pytest

from tests.golden.recording import STOPS
from tests.support.page.html_page import Page
from tests.unit.uavmap.output.flown_folders import (
    EVENTS,
    EVIL,
    PLAN,
    folder_of,
    keep_frames,
    named,
    with_troubles,
)
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.output import documents
from uavmap.output.documents import REPORT, write_documents
from uavmap.output.facts.figures import figures
from uavmap.output.facts.score import true_roi
from uavmap.output.report.page import encode
from uavmap.output.results import flown_flight, flown_of, write_results
from uavmap.ui.cli import main


def report_of(folder):
    assert main(["report", str(folder)]) == 0
    page = Page((folder / REPORT).read_text("utf-8"))
    assert not page.open
    return page


def test_report_of_a_flight_answers_a_customers_questions(tmp_path):
    folder = folder_of(tmp_path)
    text = report_of(folder).text
    for expected in (
        "golden",
        "The region is mapped to its edge all around.",
        "Unseen ground: 16 m² (0.002 ha) of the search area (8 %) have no verdict: 1 cell",
        "96 m² (0.010 ha) between 17 and 144 m² (0.002 to 0.014 ha) 6 cells of 4 m, 1 piece",
        "Middle of the region 47.30013° N, 8.50016° E",
        "UTM 32N 462,",
        "Complete: a region of 6 cells",
        "2020-01-01 00:00:00 UTC, simulated",
        "EPSG:32632",
        "grid north",
        "true north is 0.37° to the right",
        "47.3000° N",
        "8.5000° E",
        "20 m",
        "96 m² (6 cells of 4 m); between 17 m² and 144 m²",
        "40 m along the sides of cells",
        "Frames judged 34",
        "6 region, 15 not region",
        "1 96 47.300108, 8.500105 19.4 109.0 89.5 0.0 complete",
        "Search box: 11 of 12 cells decided, 1 in too few frames: a patch may be missing there.",
        "of these false positives 0",
        "vehicle 1",
        "Faults and refusals None.",
        "battery.capacity_wh 9.0",
        "Strategy rdfs, 1 vehicle, driver pymavlink, seed 11",
    ):
        assert expected in text, expected


def test_timeline_has_each_sortie_with_its_charge_and_the_fresh_battery(tmp_path):
    folder = folder_of(tmp_path)
    log = flown_of(folder).log
    (first, second), ((vehicle, swapped_s),) = log.sorties(), log.swaps
    assert (first.number, second.number, vehicle) == (1, 2, 1)
    assert first.end_s < swapped_s < second.start_s
    assert first.ended
    report_of(folder)
    page = (folder / REPORT).read_text("utf-8")
    (drawing,) = re.findall(r'aria-label="timeline".*?</svg>', page, re.DOTALL)
    assert drawing.count("vehicle 1") == 1
    assert drawing.count("<circle") == 2  # of one mark
    assert re.findall(r'data-head="Sortie">([^<]+)<', page) == ["1", "2"]
    assert re.findall(r'data-head="Lift-off">([^<]+)<', page)[0] == "2020-01-01 00:00:08"


def test_page_loads_nothing_and_runs_nothing(tmp_path):
    folder = folder_of(tmp_path)
    keep_frames(folder)
    page = report_of(folder)
    assert not {"script", "link", "iframe", "object", "base", "form"} & set(page.tags)
    for name, value in page.attributes:
        assert not name.startswith("on")
        if name in ("src", "action", "xlink:href"):
            assert value.startswith("data:image/jpeg;base64,")
        assert "http" not in value or name in ("xmlns", "href")
    links = [value for name, value in page.attributes if name == "href"]
    place = "?mlat=47.30013&mlon=8.50016#map=17"
    assert links == [f"https://www.openstreetmap.org/{place}"]  # for a person to follow
    assert "@import" not in (folder / REPORT).read_text("utf-8")
    assert page.tags.count("img") == 8


def test_text_from_outside_is_shown_as_text(tmp_path):
    plan = replace(named("R&D 'x'"), version=EVIL)
    folder = folder_of(tmp_path, with_troubles(), plan)
    keep_frames(folder)
    poses = folder / "frames" / "poses.csv"
    poses.write_text(poses.read_text("utf-8").replace(".jpg,", '"">.jpg,'), "utf-8")
    page = report_of(folder)
    assert "script" not in page.tags
    assert "img" not in page.tags  # no frame has such a name
    assert EVIL.replace("  ", " ") in page.text
    assert f"3 frames lost: {EVIL}" in page.text
    assert f"Sweep failed: refused: {EVIL}" in page.text
    assert "for debugging" not in page.text
    assert "R&D 'x'" in page.text
    assert "Frames lost 3" in page.text


def test_missing_or_invalid_frames_are_left_out(tmp_path):
    folder = folder_of(tmp_path)
    keep_frames(folder)
    outside = tmp_path / "secret.jpg"
    for number, path in enumerate(sorted((folder / "frames").glob("*.jpg"))):
        path.rename(outside) if number % 3 == 0 else path.write_bytes(b"\xff\xd8 cut short")
    poses = folder / "frames" / "poses.csv"
    poses.write_text(re.sub(r"^1-[^,]*", "../../secret.jpg", poses.read_text("utf-8"), flags=re.M))
    assert "img" not in report_of(folder).tags


def test_report_of_an_interrupted_flight_states_it(tmp_path, capsys):
    middle = next(i for i, event in enumerate(EVENTS) if event.t_s > 50.0)
    folder = folder_of(tmp_path, EVENTS[:middle])
    text = report_of(folder).text
    assert "the mission is not complete; this is its map so far" in capsys.readouterr().err
    assert "The flight is not complete: this is the map at mission time 0:49 min." in text
    assert "Not complete: a region of" in text
    assert "no landing known" in text
    assert main(["export", str(folder), "--to", "csv"]) == 0
    assert "this is its map so far, at mission time 50 s" in capsys.readouterr().err
    assert "completed,no" in (folder / "csv" / "about.csv").read_text("utf-8")


def test_journal_without_an_event_has_a_report(tmp_path):
    folder = folder_of(tmp_path, [])
    assert "Not complete: no region found in 0 judged frames" in report_of(folder).text


def test_journal_that_cannot_be_locked_or_written_is_exported(tmp_path):
    folder = folder_of(tmp_path)
    out = tmp_path / "map.gpkg"
    with Journal.open(folder / JOURNAL):
        (folder / JOURNAL).chmod(0o400)
        folder.chmod(0o500)
        try:
            assert main(["export", str(folder), "--to", "gpkg", "--out", str(out)]) == 0
        finally:
            folder.chmod(0o700)
    assert out.exists()


@pytest.mark.parametrize("command", [["report"], ["export", "--to", "gpkg"]])
def test_folder_without_results_is_refused_in_a_line(command, tmp_path, refused):
    damaged = folder_of(tmp_path)
    journal = damaged / "journal.jsonl"
    data = bytearray(journal.read_bytes())
    data[len(data) // 2] ^= 1
    journal.write_bytes(data)
    for folder in (tmp_path / "nowhere", tmp_path, damaged):
        assert str(folder) in refused(command[0], folder, *command[1:])


def test_report_to_another_folder_overwrites_nothing(tmp_path, capsys, refused):
    folder, out = folder_of(tmp_path), tmp_path / "field.html"
    assert main(["report", str(folder), "--out", str(out)]) == 0
    assert not (folder / REPORT).exists()
    before = out.read_bytes()
    capsys.readouterr()
    assert "already exists" in refused("report", folder, "--out", out)
    assert "cannot be written" in refused("report", folder, "--out", tmp_path / "no" / "a.html")
    assert out.read_bytes() == before


def test_report_made_again_is_that_of_the_flight(tmp_path):
    truth = {"min_separation_m": None, "fence_breaches": 0}
    folder = folder_of(tmp_path, truth=truth)
    setting = STOPS.setting()
    told = []
    flown, _ = flown_flight(folder, PLAN, figures(setting, EVENTS), truth)
    values = write_results(flown, told.append)
    assert not told
    report, package = (folder / REPORT).read_bytes(), (folder / "map.gpkg").read_bytes()
    assert encode(flown_of(folder)) == report
    assert main(["export", str(folder), "--to", "gpkg"]) == 0
    assert (folder / "map.gpkg").read_bytes() == package
    kept = json.loads((folder / "summary.json").read_text("utf-8"))
    assert kept == json.loads(json.dumps(values))
    assert (kept["area_m2"], kept["perimeter_m"], kept["crs"]) == (96.0, 40.0, "EPSG:32632")
    assert kept["begun_utc"] == "2020-01-01T00:00:00.000Z"
    assert kept["ended_utc"] == flown.calendar.utc(EVENTS[-1].t_s)
    roi = true_roi(setting.mission, setting.grid)
    assert kept["area_low_m2"] <= roi.area <= kept["area_high_m2"]


def test_full_disk_costs_the_page_and_never_the_map(tmp_path, monkeypatch):
    folder = folder_of(tmp_path)
    told = []
    flown, _ = flown_flight(folder, PLAN, figures(STOPS.setting(), EVENTS))

    def full(path, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(documents, "write_bytes", full)
    write_results(flown, told.append)
    assert [line.partition(": ")[0] for line in told] == [
        str(folder / "map.gpkg"),
        str(folder / "report.html"),
        str(folder / "report.pdf"),
    ]
    assert all("No space left on device" in line for line in told)
    assert all("all other results are complete" in line for line in told)
    assert f"`uavmap report {folder}`" in told[1]
    assert {path.name for path in folder.iterdir()} >= {
        "map.geojson", "map.kml", "map.png", "summary.json",
    }  # fmt: skip


def test_geopackage_open_in_another_program_is_left_alone(tmp_path):
    folder = folder_of(tmp_path)
    (folder / "map.gpkg").write_bytes(b"edited")
    (folder / "map.gpkg-wal").write_bytes(b"log")
    told = []
    write_documents(flown_of(folder), told.append)
    assert len(told) == 1
    assert "another program has it open (map.gpkg-wal)" in told[0]
    assert (folder / "map.gpkg").read_bytes() == b"edited"
    assert (folder / REPORT).exists()


def test_real_aircraft_have_real_dates_and_no_truth(tmp_path):
    plan = replace(
        PLAN, simulated=False, urls=("udpin://0.0.0.0:14550",), epoch_utc_s=1.7e9, speedup=2.0
    )
    folder = folder_of(tmp_path, plan=plan)
    flown = flown_of(folder)
    assert flown.values["begun_utc"] == "2023-11-14T22:13:20.000Z"
    assert flown.calendar.utc(20.0) == "2023-11-14T22:13:30.000Z"  # twice as fast as the clock
    text = Page(encode(flown).decode()).text
    assert "imulated" not in text.partition("Settings")[0]
    assert "Against the truth" not in text
    assert flown.data.truth is None


def test_impossible_dates_are_unknown(tmp_path):
    plan = replace(PLAN, epoch_utc_s=1e300)
    flown = flown_of(folder_of(tmp_path, plan=plan))
    assert flown.values["begun_utc"] is None
    assert "Begun not known" in Page(encode(flown).decode()).text
