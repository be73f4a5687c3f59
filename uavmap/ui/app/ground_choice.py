"""The choice of the maps beneath the drawing; the first is the lowest."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from html import escape
from typing import Any, Final
from urllib.parse import quote

from nicegui import background_tasks, ui

from missions.errors import UavmapError
from uavmap.ui.app.grounds import Facts
from uavmap.ui.app.visitor import Visitor

FINEST: Final = 22


class GroundChoice:
    """The list of maps of the folder; the first file is shown from the beginning."""

    def __init__(self, visitor: Visitor, on: ui.leaflet) -> None:
        self._grounds = visitor.app.grounds
        self._map = on
        self._layers: dict[str, Any] = {}
        names = self._names()
        self._chosen = ui.select(names, multiple=True, label="maps beneath").mark("beneath")
        self._chosen.props("dense outlined use-chips").classes("app-beneath")
        self._chosen.on_value_change(lambda event: self._show(list(event.value or ())))
        self._hint = ui.label(
            "This page loads no map from the internet. Put a map file into the folder, or give a "
            "latitude and longitude."
        ).classes("app-hint")
        self._hint.set_visibility(not names)
        background_tasks.create(self._choose_first(names), name="first map")
        visitor.on_update(self._update)

    def _names(self) -> list[str]:
        return [*self._grounds.files(), *self._grounds.mosaics()]

    async def _choose_first(self, names: Sequence[str]) -> None:
        """Show the first map that can be shown."""
        await self._map.initialized()  # an earlier move of the map is lost
        for name in names:
            with contextlib.suppress(UavmapError):
                await asyncio.to_thread(self._grounds.facts, name)
                self._chosen.set_value([name])
                return

    def _update(self) -> None:
        names = self._names()
        if names == self._chosen.options:
            return
        none_yet = not self._chosen.options
        self._hint.set_visibility(not names)
        self._chosen.set_options(names, value=[n for n in self._chosen.value or () if n in names])
        if none_yet:
            background_tasks.create(self._choose_first(self._grounds.files()), name="first map")

    async def _show(self, names: list[str]) -> None:
        found: dict[str, Facts] = {}
        for name in names:  # in a thread, since another may render a tile of it
            try:
                found[name] = await asyncio.to_thread(self._grounds.facts, name)
            except UavmapError as error:
                ui.notify(str(error))
        if names != list(self._chosen.value or ()):
            return  # the choice has changed meanwhile
        shown: dict[str, Any] = {}
        for layer in self._layers.values():
            self._map.remove_layer(layer)
        for name, ground in found.items():
            options = {
                "maxZoom": FINEST,
                "minZoom": ground.zooms[0],
                "maxNativeZoom": ground.zooms[-1],
                "attribution": escape(ground.attribution),
            }
            url = f"/ground/{{z}}/{{x}}/{{y}}/{quote(name)}"
            shown[name] = self._map.tile_layer(url_template=url, options=options)
            if name not in self._layers:  # show the place of the newest choice
                self._map.set_center(ground.middle)
                self._map.set_zoom(min(ground.zooms[-1], FINEST))
        self._layers = shown
