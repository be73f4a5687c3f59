"""report.html in a real browser: on a phone and a screen, folded settings, and in print."""

from __future__ import annotations

import base64
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.rig import wait_until
from tests.support.page.browser import browser, need_browser
from tests.unit.uavmap.output.flown_folders import (
    CLASS_EVENTS,
    CLASS_PLAN,
    EVENTS,
    PLAN,
    folder_of,
    keep_frames,
    with_troubles,
)
from tests.unit.uavmap.output.report.test_words import photographed
from uavmap.ui.cli import main

PHONE, SCREEN = 360, 1280
BROKEN = r"""
const broken = [], texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (texts.nextNode()) {
  const text = texts.currentNode;
  if (text.parentElement.closest("svg")) continue;
  for (const word of text.data.matchAll(/[\p{L}\p{N}.,°²]+/gu)) {
    const range = document.createRange();
    range.setStart(text, word.index);
    range.setEnd(text, word.index + word[0].length);
    const lines = [...range.getClientRects()].filter(box => box.width > 0).map(box => box.top);
    if (new Set(lines.map(Math.round)).size > 1) broken.push(word[0]);
  }
}
return broken;
"""
"""Words that stand on two lines, in JavaScript."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    photographs, replay = photographed(5, refused=2)
    made = {
        "flight": (with_troubles(), PLAN, {}),
        "classes": (CLASS_EVENTS, CLASS_PLAN, {}),
        "half": (EVENTS[: len(EVENTS) // 2], PLAN, {}),
        "replay": (photographs, PLAN, replay),
    }
    found = {}
    for name, (events, plan, meta) in made.items():
        folder = folder_of(tmp_path_factory.mktemp(name), events, plan, **meta)
        if name == "flight":
            keep_frames(folder)
        assert main(["report", str(folder)]) == 0
        found[name] = folder / "report.html"
    return found


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    need_browser()
    with browser() as driver:
        yield driver


@pytest.mark.parametrize("width_px", [PHONE, SCREEN])
@pytest.mark.parametrize("name", ["flight", "classes", "half", "replay"])
def test_report_fits_the_width_and_breaks_no_word(
    name: str, width_px: int, pages: dict[str, Path], driver: Any
) -> None:
    size = {"width": width_px, "height": 800, "deviceScaleFactor": 1, "mobile": width_px == PHONE}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    driver.get(pages[name].as_uri())
    assert driver.execute_script("return window.innerWidth") == width_px
    assert not driver.execute_script(BROKEN)
    folded = driver.execute_script("return document.documentElement.scrollHeight")
    driver.execute_script("document.querySelectorAll('details').forEach(part => part.open = true)")
    assert driver.execute_script("return document.documentElement.scrollWidth") <= width_px
    assert driver.execute_script("return document.documentElement.scrollHeight") > folded + 500
    assert not [line for line in driver.get_log("browser") if line["level"] == "SEVERE"]


def printed(driver: Any) -> bytes:
    """Return the page as PDF. Chromium's printer gives up at times on a busy computer."""
    from selenium.common.exceptions import WebDriverException  # noqa: PLC0415 - it may be missing

    data: list[str] = []

    def prints() -> bool:
        with contextlib.suppress(WebDriverException):
            done = driver.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
            data.append(done["data"])
        return bool(data)

    wait_until(prints, "the page on paper")
    return base64.b64decode(data[0])


def test_report_is_printed_without_its_settings(pages: dict[str, Path], driver: Any) -> None:
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 is not installed")
    driver.get(pages["half"].as_uri())
    with pdfium.PdfDocument(printed(driver)) as document:
        text = " ".join(page.get_textpage().get_text_bounded() for page in document)
        assert len(document) <= 3
    assert "signature" in text
    assert "battery.capacity_wh" not in text
