"""Results: the maps of flights and replays, with report, export and resume."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from uavmap.output.documents import FORMATS
from uavmap.ui.app.visitor import Visitor
from uavmap.ui.app.workspace import ResultsFolder, verdict
from uavmap.ui.page.server import ask

FILES: Final = (*dict.fromkeys((
    "report.html", "report.pdf", "map.png", *(made.name for made in FORMATS.values()),
    "map.geojson", "boundary.geojson", "ortho.tif", "mosaic.webp", "summary.json", "mission.toml",
)),)  # fmt: skip
"""Files of a results folder, in the order of the links."""
EXPORT: Final = "kmz"
"""Default format: one file that opens in Google Earth."""


class Results:
    """The tab of maps."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._listed: list[object] | None = None
        self._list = ui.element("div").classes("app-results")
        visitor.on_update(self._update)

    def _update(self) -> None:
        found = self._visitor.app.workspace.results()
        listed: list[object] = [(flown.stamp, files_of(flown)) for flown in found]
        if listed == self._listed:
            return
        self._listed = listed
        self._list.clear()
        with self._list:
            if not found:
                ui.label("There is no map yet: practise a mission, or map photographs.")
            for flown in found:
                self._show(flown)

    def _show(self, flown: ResultsFolder) -> None:
        visitor, name, summary = self._visitor, flown.name, flown.summary()
        with ui.element("div").classes("app-result"):
            if (flown.folder / "map.png").is_file():
                picture = visitor.file_url(f"{name}/map.png")
                ui.html(f'<a href="{picture}" target="_blank"><img src="{picture}" alt="map"></a>')
            with ui.element("div"):
                ui.label(name).classes("app-title")
                ui.label(verdict(summary))
                with ui.row().classes("app-row"):
                    for file in files_of(flown):
                        ui.link(file, visitor.file_url(f"{name}/{file}"), new_tab=True)
                with ui.row().classes("app-row"):
                    visitor.button("Report (PDF)", lambda: self._run("report", name))
                    visitor.button("Watch the flight", lambda: self._watch(name))
                    if summary is None or not summary.get("completed"):
                        visitor.button("Resume", lambda: self._resume(name), grave=True)
                    chosen = ui.select(list(FORMATS), value=EXPORT, label="format")
                    chosen.props("dense outlined").classes("app-format")
                    visitor.button(
                        "Export", lambda: self._run("export", name, "--to", chosen.value)
                    )

    def _run(self, *words: str) -> None:
        self._visitor.run(words)

    async def _resume(self, name: str) -> None:
        question = "The mission continues: real vehicles take off. Is the field clear?"
        if await ask(question, "Resume", "Cancel") is not None:
            self._run("resume", name, "--yes", *self._visitor.app.page_words("--page"))

    def _watch(self, name: str) -> None:
        self._visitor.run(["watch", name, *self._visitor.app.page_words("--port")])


def files_of(flown: ResultsFolder) -> list[str]:
    """Return the existing files among `FILES`."""
    return [file for file in FILES if (flown.folder / file).is_file()]
