"""Pictures: a map of recorded photographs, and a detector from painted ones."""

from __future__ import annotations

from typing import Any, Final

from nicegui import ui

from missions.errors import UavmapError
from uavmap.ui.app.visitor import Visitor
from uavmap.ui.app.workspace import PICTURES

MOST_BYTES: Final = 100_000_000
MASKS: Final = "-painted"
"""The folder of the masks of `photos` is `photos-painted`."""


class Pictures:
    """The tab of recorded pictures."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, workspace = visitor, visitor.app.workspace
        ui.label("Map the photographs of a flight; paint two or three to say what to look for.")
        self._into = ui.input("folder for new photographs", value="photos").mark("into")
        ui.upload(
            label="photographs", multiple=True, auto_upload=True, on_upload=self._upload,
            max_file_size=MOST_BYTES,
        ).props(f"accept={','.join(PICTURES)} flat bordered").classes("app-wide")  # fmt: skip
        self._folder = visitor.select("photographs", workspace.picture_folders)
        self._mission = visitor.select("mission", lambda: ["", *workspace.missions()])
        self._detector = visitor.select("detector", lambda: ["", *workspace.detectors()])
        visitor.button("Map", self._replay).mark("replay")
        visitor.button("Paint and learn", self._tune).mark("tune")

    async def _upload(self, event: Any) -> None:
        await self._visitor.keep(event, (self._into.value or "photos").strip())

    def _photographs(self) -> str:
        if not self._folder.value:
            raise UavmapError("no photographs: upload some")
        return str(self._folder.value)

    def _replay(self) -> None:
        words = ["replay", self._photographs()]
        words += ["--mission", self._mission.value] if self._mission.value else []
        words += ["--detector", self._detector.value] if self._detector.value else []
        self._visitor.run(words)

    def _tune(self) -> None:
        folder = self._photographs()
        self._visitor.run(["tune", folder, "--paint", "--examples", f"{folder}{MASKS}",
                           "--out", f"{folder}-detector"])  # fmt: skip
