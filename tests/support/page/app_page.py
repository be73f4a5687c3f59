"""The page of `uavmap app` as a test uses it: visible elements, and clicks alone."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.e2e import rig

CORNERS = "8.6,47.4 8.6003,47.4 8.6003,47.4002 8.6,47.4002 8.6,47.4"
KML = f"""<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>meadow</name><Polygon>
<outerBoundaryIs><LinearRing><coordinates>{CORNERS}</coordinates></LinearRing></outerBoundaryIs>
</Polygon></Placemark></kml>"""
PATIENCE_S = rig.PATIENCE_S


@contextlib.contextmanager
def app(folder: Path, *more: object) -> Iterator[tuple[Any, str]]:
    """Run `uavmap app` in a folder; yield the URL that it prints."""
    with rig.started("app", folder, "--port", 0, *more) as process:
        line = process.stderr.readline()
        found = re.search(r"uavmap app: (http\S+)", line)
        assert found, line
        yield process, found[1]


class Page:
    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def element(self, selector: str, text: str | None = None) -> Any:
        """Return the first visible element; of those with a text the one that has it."""
        for each in self.driver.find_elements("css selector", selector):
            with contextlib.suppress(Exception):  # it moves, or is gone again
                if each.is_displayed() and (text is None or each.text == text):
                    return each
        return None

    def see(self, selector: str, text: str | None = None) -> Any:
        rig.wait_until(
            lambda: self.element(selector, text) is not None, f"{text or selector}", PATIENCE_S
        )
        return self.element(selector, text)

    def press(self, text: str | None, selector: str = "button") -> None:
        rig.wait_until(lambda: self._pressed(selector, text), f"{text or selector} to press", 60.0)

    def _pressed(self, selector: str, text: str | None) -> bool:
        button = self.element(selector, text)
        with contextlib.suppress(Exception):
            if button is not None and button.is_enabled():
                button.click()
                return True
        return False

    def open(self, tab: str) -> None:
        self.press(tab, ".q-tab")

    def choose(self, label: str, choice: str) -> None:
        """Choose one of a list; its popup may move while it is pressed."""

        def field() -> Any:
            for each in self.driver.find_elements("css selector", f'input[aria-label="{label}"]'):
                whole = each.find_element("xpath", "./ancestor::label")
                if whole.is_displayed():
                    return whole
            return None

        def chosen() -> bool:
            with contextlib.suppress(Exception):
                return choice in field().text
            return False

        def pressed() -> bool:
            with contextlib.suppress(Exception):
                item = self.element(".q-item", choice)
                (field() if item is None else item).click()
                rig.wait_until(
                    chosen if item else lambda: bool(self.element(".q-item")), label, 3.0
                )
            return chosen()

        rig.wait_until(lambda: chosen() or pressed(), f"{choice} of {label}", 60.0)

    def write(self, label: str, text: str) -> None:
        from selenium.webdriver import Keys  # noqa: PLC0415 - it may be missing

        box = self.see(f'input[aria-label^="{label}"]')
        box.send_keys(Keys.CONTROL, "a")
        box.send_keys(text)

    def write_lines(self, label: str, text: str) -> None:
        from selenium.webdriver import Keys  # noqa: PLC0415 - it may be missing

        box = self.see(f'textarea[aria-label^="{label}"]')
        box.send_keys(Keys.CONTROL, "a")
        box.send_keys(text)

    def send(self, file: Path) -> None:
        """Choose a file to import."""
        self.driver.find_element("css selector", "input[type=file]").send_keys(str(file))

    def shows(self, text: str) -> bool:
        return text in self.driver.execute_script("return document.body.innerText")

    def wait(self, text: str) -> None:
        rig.wait_until(lambda: self.shows(text), text, PATIENCE_S)

    def ended(self, command: str) -> None:
        """Wait until a command is shown that has ended well."""
        rig.wait_until(
            lambda: self.shows(command) and self.shows("done (exit code 0)"), command, PATIENCE_S
        )

    @contextlib.contextmanager
    def within(self) -> Iterator[None]:
        """Switch into the page of a command once it is there."""
        frame = self.see(".app-frame-page")
        self.driver.switch_to.frame(frame)
        try:
            yield
        finally:
            self.driver.switch_to.default_content()

    def complaints(self) -> list[Any]:
        """Return the errors in the browser's console since the last call."""
        return [each for each in self.driver.get_log("browser") if each["level"] == "SEVERE"]
