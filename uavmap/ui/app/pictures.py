"""Pictures: a map of recorded photographs, and a detector from painted ones."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any, Final

from nicegui import ui

from missions.errors import UavmapError
from uavmap.ui.app.visitor import Visitor
from uavmap.ui.app.workspace import PICTURES

MASKS: Final = "-painted"
"""The folder of the masks of `photos` is `photos-painted`."""


class Pictures:
    """The tab of recorded pictures."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("div").classes("app-form"):
            self._add_form(visitor)

    def _add_form(self, visitor: Visitor) -> None:
        workspace = visitor.app.workspace
        ui.label(
            "Map the photographs of a flight. Paint two or three of them first, to show what to "
            "look for: the detector that is learned is a choice below once it is ready."
        )
        self._into = ui.input("folder for new photographs", value="photos").mark("into")
        visitor.upload("Send photographs", PICTURES, self._upload)
        self._folder = visitor.select(
            "photographs, or a flight that has kept its pictures",
            lambda: [*workspace.picture_folders(), *workspace.flights_with_pictures()],
        ).mark("photographs")
        self._mission = visitor.select(
            "mission", workspace.missions, none="that of the flight, or one made from the pictures"
        )
        self._detector = visitor.select("detector", workspace.detectors, none="the mission's")
        with ui.row().classes("app-row"):
            visitor.button("Paint and learn", self._tune).mark("tune")
            visitor.button("Map", self._replay).mark("replay")

    async def _upload(self, event: Any) -> None:
        await self._visitor.keep(event, (self._into.value or "photos").strip())

    def _photographs(self) -> str:
        if not self._folder.value:
            raise UavmapError("no photographs: upload some, or keep those of a flight")
        return str(self._folder.value)

    def _replay(self) -> None:
        words = ["replay", self._photographs()]
        words += ["--mission", self._mission.value] if self._mission.value else []
        words += ["--detector", self._detector.value] if self._detector.value else []
        self._visitor.run(words)

    def _tune(self) -> None:
        workspace, name = self._visitor.app.workspace, self._photographs()
        stem = PurePath(name).name  # masks and detector lie in the workspace, also of a flight
        self._visitor.run(
            ["tune", workspace.folder_to_paint(name), "--paint", "--examples", f"{stem}{MASKS}",
             "--out", workspace.new_folder(f"{stem}-detector")]
        )  # fmt: skip
