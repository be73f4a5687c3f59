"""A real browser for tests: Chromium without a window, by its driver, if installed."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

CHROMIUM, DRIVER = Path("/usr/bin/chromium"), Path("/usr/bin/chromedriver")
FOLDER = os.environ.get("UAVMAP_PICTURES")
"""Folder for the pictures of the documentation."""
_ARGUMENTS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--disable-extensions", "--disable-default-apps",
    "--disable-domain-reliability", "--disable-client-side-phishing-detection",
    # no requests of the browser itself
    *(f"--{name}-url=http://127.0.0.1:9/"
      for name in ("gaia", "google-base", "gcm-checkin", "gcm-registration")),
    "--disable-features=OptimizationHints,OptimizationGuideModelDownloading,"
    "OptimizationGuideOnDeviceModel,AutofillServerCommunication,MediaRouter,Translate,"
    "PreconnectToSearch,NetworkTimeServiceQuerying",
)  # fmt: skip


def need_browser() -> None:
    """Skip the test, with the reason, if no browser is installed."""
    pytest.importorskip("selenium", reason="selenium is not installed")
    for program in (CHROMIUM, DRIVER):
        if not program.exists():
            pytest.skip(f"there is no {program}: the page is tested without a browser only")


@contextlib.contextmanager
def browser(
    width_px: int = 1280, height_px: int = 800, proxy_port: int | None = None
) -> Iterator[Any]:
    """Open Chromium; its requests go through the proxy at a port of loopback, if given."""
    from selenium import webdriver  # noqa: PLC0415 - it may be missing
    from selenium.webdriver.chrome.service import Service  # noqa: PLC0415

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        for argument in (*_ARGUMENTS, f"--user-data-dir={profile}"):
            options.add_argument(argument)
        options.add_argument(f"--window-size={width_px},{height_px}")
        if proxy_port is not None:  # also its requests to loopback
            options.add_argument(f"--proxy-server=http://127.0.0.1:{proxy_port}")
            options.add_argument("--proxy-bypass-list=<-loopback>")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
        try:
            driver.set_window_size(width_px, height_px)  # it does not begin as narrow as a phone
            yield driver
        finally:
            driver.quit()


def keep_picture(driver: Any, name: str) -> None:
    """Keep a picture of the page in the folder `UAVMAP_PICTURES`, if that is given."""
    if FOLDER:
        with Image.open(io.BytesIO(driver.get_screenshot_as_png())) as image:
            image.thumbnail((900, 900))
            image.convert("RGB").save(Path(FOLDER) / name, quality=80, optimize=True)
