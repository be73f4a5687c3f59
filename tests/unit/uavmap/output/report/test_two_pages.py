"""report.pdf: two pages A4 with embedded fonts, read back by PDFium."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from missions.events import Event
from tests.unit.uavmap.output.flown_folders import (
    CLASS_EVENTS,
    CLASS_PLAN,
    EVENTS,
    EVIL,
    PLAN,
    folder_of,
    keep_frames,
    named,
    with_troubles,
)
from tests.unit.uavmap.output.report.test_words import photographed
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output import documents
from uavmap.output.documents import REPORT, REPORT_PDF, write_documents
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.results import flown_of
from uavmap.ui.cli import main

pytest.importorskip("reportlab", reason="reportlab (the extra pdf) is not installed")
pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 is not installed")

A4_PT = (595.28, 841.89)
HALF = next(i for i, event in enumerate(EVENTS) if event.t_s > 50.0)


def encoded(flown: FlownMission) -> bytes:
    from uavmap.output.report.two_pages import encode  # noqa: PLC0415 - an extra

    return encode(flown)


def texts(data: bytes) -> list[str]:
    """Return the words of each page, after checks that hold for every report."""
    with pdfium.PdfDocument(data) as document:
        found = []
        for page in document:
            assert page.get_size() == pytest.approx(A4_PT, abs=0.01)
            words = page.get_textpage().get_text_bounded()
            fonts = {
                thing.get_font()
                for thing in page.get_objects(filter=[pdfium.raw.FPDF_PAGEOBJ_TEXT])
            }
            assert all(font.is_embedded for font in fonts)
            assert {font.get_base_name().rpartition("+")[2][:17] for font in fonts} <= {
                "BitstreamVeraSans"
            }
            found.append(" ".join(words.split()))
    assert len(found) == 2
    for number, words in enumerate(found, start=1):
        assert words.endswith(f"page {number} of 2"), words
    return found


def in_order(text: str, parts: Sequence[str]) -> None:
    places = [text.find(part) for part in parts]
    assert -1 not in places, [part for part, at in zip(parts, places, strict=True) if at < 0]
    assert places == sorted(places)


def test_pdf_of_a_flight_has_two_pages_with_unknowns_first(tmp_path: Path) -> None:
    first, second = texts(encoded(flown_of(folder_of(tmp_path))))
    in_order(
        first,
        [
            "golden",
            "The region is mapped to its edge all around.",
            "Simulated: ",
            "Unseen ground: 16 m² (0.002 ha)",
            "Area of the region",
            "96 m² (0.010 ha)",
            "between 17 and 144 m²",
        ],
    )
    for part in ("47.30013° N, 8.50016° E map", "32N 462,", "EPSG:32632", "grid north", " 5 m"):
        assert part in first, part
    in_order(
        second,
        [
            "Times and aircraft",
            "Pictures judged 34",
            "vehicle 1",
            "0:00 is 2020-01-01 00:00:00 UTC, simulated",
            "Corners of the map",
            "Judging, and work not done",
            "Region is: darker than",
            "checked by",
            "signature",
        ],
    )
    assert "battery.capacity_wh" not in first + second  # settings are in report.html


@pytest.mark.parametrize(
    ("events", "plan", "expected"),
    [
        (EVENTS[:HALF], PLAN, "The flight is not complete: this is the map at mission time 0:49"),
        ([], PLAN, "No region is found so far."),
        (CLASS_EVENTS, CLASS_PLAN, "wet & <dry>: 64 m² (21 to 74), 0.0213 to 0.148 litres"),
        (with_troubles(), PLAN, "Unseen ground"),
        (
            EVENTS,
            named(("Fläche ½ ±35 °C, Łódź 東 " * 4).strip()),
            "Fläche ½ ±35 °C, Łódz ? Fläche",
        ),
        (with_troubles(), replace(named("R&D 'x'"), version=EVIL), "R&D 'x'"),
    ],
)
def test_pdf_of_any_flight_has_two_pages(
    events: Sequence[Event], plan: FlightPlan, expected: str, tmp_path: Path
) -> None:
    flown = flown_of(folder_of(tmp_path, list(events), plan))
    data = encoded(flown)
    assert expected in texts(data)[0]
    assert encoded(flown) == data


@pytest.mark.parametrize("taken", [0, 5])
def test_pdf_of_a_replay_has_no_aircraft_and_no_search_area(taken: int, tmp_path: Path) -> None:
    events, meta = photographed(taken, refused=1)
    first, second = texts(encoded(flown_of(folder_of(tmp_path, events, **meta))))
    assert "pictures can be used" in first or "The region is mapped from 5 pictures." in first
    assert f"Pictures in the map {taken} of {taken + 1}" in second
    assert not re.search("vehicle|search area|sortie|battery", first + second, re.IGNORECASE)


def test_pdf_with_many_vehicles_pieces_and_faults_is_shrunk_to_two_pages(tmp_path: Path) -> None:
    flown = flown_of(folder_of(tmp_path, with_troubles()))
    for number in range(2, 21):
        flown.log.fixes[number] = flown.log.fixes[1]
    lost = [trouble for trouble in flown.log.troubles for _ in range(40)]
    flown.log.troubles.extend(
        trouble._replace(t_s=float(n), kind="fault", text=f"{n} {EVIL * 5}")
        for n, trouble in enumerate(lost)
    )
    notes = {str(number): f"came home {EVIL}" for number in range(20)}
    values = {**flown.values, "patches": [*flown.values["patches"]] * 30, "notes": notes}
    first, second = texts(encoded(replace(flown, values=values)))
    assert "more in report.html." in first
    assert second.count("more in report.html.") == 3
    assert "signature" in second


def test_pdf_draws_the_region_where_the_map_is(tmp_path: Path) -> None:
    data = encoded(flown_of(folder_of(tmp_path)))
    with pdfium.PdfDocument(data) as document:
        picture = np.asarray(document[0].render(scale=60 / 72).to_pil().convert("RGB"), np.int16)
    green = np.abs(picture - (116, 178, 122)).max(axis=2) < 12  # cells of the region, explored
    rows, columns = np.nonzero(green)
    assert green.sum() > 500
    assert 0.25 * picture.shape[0] < rows.mean() < 0.85 * picture.shape[0]
    assert 0.2 * picture.shape[1] < columns.mean() < 0.8 * picture.shape[1]


def test_report_writes_page_and_pdf_or_the_one_that_out_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = folder_of(tmp_path), tmp_path / "field.PDF"
    keep_frames(folder)
    assert main(["report", str(folder)]) == 0
    assert capsys.readouterr().err.splitlines()[-2:] == [
        str(folder / REPORT), str(folder / REPORT_PDF)
    ]  # fmt: skip
    (folder / REPORT).unlink()
    assert main(["report", str(folder), "--out", str(out)]) == 0
    assert out.read_bytes() == (folder / REPORT_PDF).read_bytes()
    assert not (folder / REPORT).exists()
    write_documents(flown_of(folder), print)
    assert out.read_bytes() == (folder / REPORT_PDF).read_bytes()


def test_report_without_reportlab_writes_the_page_and_names_the_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, refused
) -> None:
    folder, out = folder_of(tmp_path), tmp_path / "field.pdf"
    monkeypatch.setitem(sys.modules, "reportlab", None)
    assert not documents.prints_pdf()
    assert main(["report", str(folder)]) == 0
    assert "no report.pdf: it needs reportlab: " in capsys.readouterr().err.splitlines()[-1]
    assert "a PDF needs reportlab: " in refused("report", folder, "--out", out)
    lines: list[str] = []
    write_documents(flown_of(folder), lines.append)
    assert not lines
    assert not {REPORT_PDF, "field.pdf"} & {path.name for path in folder.rglob("*")}


def test_judged_picture_is_in_the_pdf(tmp_path: Path) -> None:
    from PIL import Image  # noqa: PLC0415

    folder = folder_of(tmp_path)
    without = encoded(flown_of(folder))
    buffer = io.BytesIO()
    Image.new("RGB", (640, 480), (10, 200, 30)).save(buffer, "JPEG")
    (folder / "judged.jpg").write_bytes(buffer.getvalue())
    with pdfium.PdfDocument(encoded(flown_of(folder))) as document:
        images = list(document[1].get_objects(filter=[pdfium.raw.FPDF_PAGEOBJ_IMAGE]))
    assert len(images) == 1
    assert "Outlined in red" not in texts(without)[1]
