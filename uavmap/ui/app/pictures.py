"""Pictures: map recorded photographs, and train a detector on painted ones."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any, Final

from nicegui import ui

from missions.errors import UavmapError
from uavmap.ui.app.visitor import Visitor
from uavmap.ui.app.workspace import PICTURES

MASKS: Final = "-painted"
"""Ending of the folder of masks: the masks of `photos` are in `photos-painted`."""


class Pictures:
    """The tab of recorded pictures."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("div").classes("app-form"):
            self._add_form(visitor)

    def _add_form(self, visitor: Visitor) -> None:
        workspace = visitor.app.workspace
        ui.label(
            "Map the photographs of a flight. To train a detector first, paint the region in two "
            "or three of them. Then choose the new detector below."
        )
        self._into = ui.input("folder for new photographs", value="photos").mark("into")
        visitor.upload("Send photographs", PICTURES, self._upload)
        self._folder = visitor.select(
            "photographs, or a flight with kept pictures",
            lambda: [*workspace.picture_folders(), *workspace.flights_with_pictures()],
        ).mark("photographs")
        self._mission = visitor.select(
            "mission", workspace.missions, none="from the flight, or made from the pictures"
        )
        self._detector = visitor.select("detector", workspace.detectors, none="the mission's")
        with ui.row().classes("app-row"):
            visitor.button("Paint and learn", self._tune).mark("tune")
            visitor.button("Map", self._replay).mark("replay")

    async def _upload(self, event: Any) -> None:
        await self._visitor.keep(event, (self._into.value or "photos").strip())

    def _photographs(self) -> str:
        if not self._folder.value:
            raise UavmapError("no photographs: send some, or keep the pictures of a flight")
        return str(self._folder.value)

    def _replay(self) -> None:
        words = ["replay", self._photographs()]
        words += ["--mission", self._mission.value] if self._mission.value else []
        words += ["--detector", self._detector.value] if self._detector.value else []
        self._visitor.run(words)

    def _tune(self) -> None:
        workspace, name = self._visitor.app.workspace, self._photographs()
        stem = PurePath(name).name  # masks and detector are in the workspace, also for a flight
        self._visitor.run(
            ["tune", workspace.folder_to_paint(name), "--paint", "--examples", f"{stem}{MASKS}",
             "--out", workspace.new_folder(f"{stem}-detector")]
        )  # fmt: skip
