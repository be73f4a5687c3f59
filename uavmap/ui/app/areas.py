"""Areas: draw or import an area, make a mission of it, and see its plan."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from nicegui import ui

from missions.errors import UavmapError
from missions.units import LatLon
from uavmap.base.atomic_write import write_text
from uavmap.load.areas.drones import CAMERAS, DRONES
from uavmap.load.areas.formats import SUFFIXES
from uavmap.load.areas.layout import rectangle
from uavmap.ui.app.ground_choice import GroundChoice
from uavmap.ui.app.visitor import Visitor
from vision.detectors import FINDS, FROM_FILES

KINDS: Final = {"": "area to search", "geofence": "geofence", "no-fly": "no-fly zone"}
"""Kinds of polygons, by the name that `uavmap new` reads."""
_LATER: Final = {"later": "choose later (real aircraft do not fly before)"}
"""The choice of `uavmap new` without a detector."""
PLACE: Final = (20.0, 0.0)
"""Centre of the map before the place of the field is known: latitude, longitude, degrees."""
_BLUE, _RED, _BLACK = "#3d6fb6", "#b02a37", "#23272b"
_COLOURS: Final = {"": _BLUE, "geofence": _RED, "no-fly": _BLACK}


def drawn_features(shapes: Sequence[tuple[str, Mapping[str, Any]]]) -> dict[str, Any]:
    """Return a drawing as GeoJSON for `uavmap new`, from kinds and layers of Leaflet.

    >>> corner = {"lat": 1.0, "lng": 2.0}
    >>> found = drawn_features([("home", {"_latlng": corner})])
    >>> found["features"][0]["geometry"], found["features"][0]["properties"]
    ({'type': 'Point', 'coordinates': [2.0, 1.0]}, {'name': 'home'})
    """
    features = []
    for number, (kind, layer) in enumerate(shapes, 1):
        if kind == "home":
            geometry: dict[str, Any] = {"type": "Point", "coordinates": _place(layer["_latlng"])}
            name = kind
        else:
            ring = [_place(corner) for corner in layer["_latlngs"][0]]
            geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
            name = f"{kind} {number}".strip() if kind else f"area {number}"
        features.append({"type": "Feature", "properties": {"name": name}, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def _place(corner: Mapping[str, float]) -> list[float]:
    return [round(float(corner["lng"]), 8), round(float(corner["lat"]), 8)]


class Areas:
    """The tab that makes missions."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._shapes: list[tuple[str, dict[str, Any]]] = []
        self._layers: list[Any] = []
        self._file: str | None = None
        """The imported file; None for a drawing."""
        with ui.element("div").classes("app-columns"):
            with ui.element("div").classes("app-map"):
                self._add_map()
            with ui.element("div").classes("app-form"):
                self._add_form()
                self.plan = ui.element("div").classes("app-plan")
        visitor.on_end("new", self._show_plan)

    # --- the map -------------------------------------------------------------------------------
    def _add_map(self) -> None:
        with ui.row().classes("app-row"):
            self._kind = ui.toggle(KINDS, value="").props("no-caps padding='xs sm'").mark("kind")
            self._undo = ui.button("Undo", on_click=self._remove_last).props("no-caps flat dense")
        draw = {"polygon": True, "rectangle": True, "marker": True, "polyline": False,
                "circle": False, "circlemarker": False}  # fmt: skip
        self.map = ui.leaflet(
            center=PLACE, zoom=3, draw_control={"draw": draw, "edit": False}, hide_drawn_items=True
        ).classes("app-leaflet")
        self.map.clear_layers()  # the default loads tiles from another host
        self.map.on("draw:created", self._add_shape)
        with ui.row().classes("app-row"):
            self._beneath = GroundChoice(self._visitor, self.map)
            self._at = ui.input("go to: latitude, longitude").props("dense outlined")
            self._at.classes("app-at").mark("at")
            ui.button("Go", on_click=self._go).props("no-caps flat dense").mark("go")
        with ui.row().classes("app-row"):
            self._wide, self._high = (
                ui.number(f"{side}, m", value=100, min=4, max=10_000).props("dense outlined")
                for side in ("width", "height")
            )
            ui.button("Draw around the centre", on_click=self._add_rectangle).props(
                "no-caps flat dense"
            )

    def _go(self) -> None:
        try:
            lat, lon = (float(part) for part in self._at.value.split(","))
        except (AttributeError, ValueError):
            ui.notify("enter latitude and longitude in degrees, such as 47.3, 8.5")
            return
        self.map.set_center((lat, lon))
        self.map.set_zoom(17)

    def _add_rectangle(self) -> None:
        """Draw a rectangle without a pointer."""
        try:
            corners = rectangle(
                LatLon(*self.map.center), self._wide.value or 0.0, self._high.value or 0.0
            )
        except UavmapError as error:
            ui.notify(str(error))
            return
        ring = [{"lat": corner.lat_deg, "lng": corner.lon_deg} for corner in corners]
        self._add(self._kind.value, {"_latlngs": [ring]})

    def _add_shape(self, event: Any) -> None:
        kind = "home" if event.args["layerType"] == "marker" else self._kind.value
        self._add(kind, event.args["layer"])

    def _add(self, kind: str, layer: dict[str, Any]) -> None:
        self._shapes.append((kind, layer))
        if kind == "home":
            corner = layer["_latlng"]
            self._layers.append(self.map.marker(latlng=(corner["lat"], corner["lng"])))
        else:
            corners = [[c["lat"], c["lng"]] for c in layer["_latlngs"][0]]
            colour = {"color": _COLOURS[kind], "fillOpacity": 0.15}
            self._layers.append(self.map.generic_layer(name="polygon", args=[corners, colour]))
        self._file = None
        self._source.set_text(f"drawn: {len(self._shapes)}")

    def _remove_last(self) -> None:
        if self._shapes:
            self._shapes.pop()
            self.map.remove_layer(self._layers.pop())
            self._source.set_text(f"drawn: {len(self._shapes)}")

    # --- the mission ---------------------------------------------------------------------------
    def _add_form(self) -> None:
        shipped = {name: text for name, text in FINDS.items() if name not in FROM_FILES}
        learned = dict.fromkeys(self._visitor.app.workspace.detectors(), "learned")
        detectors = _LATER | shipped | learned
        self._source = ui.label("draw an area on the map, or import a file").mark("source")
        self._visitor.upload(
            "Import KML, GeoJSON, Shapefile (.zip), .plan ...", SUFFIXES, self._import
        )
        self._name = ui.input("name of the mission", value="field").mark("name")
        self._drone = ui.select(list(DRONES), value="sim", label="drone").mark("drone")
        cameras = {"": "the drone's own"} | {name: name for name in CAMERAS}
        self._camera = ui.select(cameras, value="", label="camera").mark("camera")
        self._vehicles = ui.number("vehicles", value=1, min=1, max=20, format="%d").mark("vehicles")
        self._detector = ui.select(
            {name: f"{name}: {text}" for name, text in detectors.items()},
            value="threshold", label="detector",
        ).classes("app-wide").mark("detector")  # fmt: skip
        self._visitor.button("Make the mission", self._make).mark("make")

    async def _import(self, event: Any) -> None:
        if (name := await self._visitor.keep(event)) is not None:
            self._file = name
            self._source.set_text(f"imported: {name}")

    def _make(self) -> None:
        workspace = self._visitor.app.workspace
        mission = workspace.new_name(self._name.value or "", ".toml")
        if self._file is None and not any(kind == "" for kind, _ in self._shapes):
            raise UavmapError("no area: draw one on the map, or import a file")
        source = self._file
        if source is None:
            source = mission.removesuffix(".toml") + ".geojson"
            text = json.dumps(drawn_features(self._shapes), indent=1)
            write_text(workspace.folder / source, text)
        words = ["new", source, "--out", mission, "--drone", self._drone.value]
        words += ["--vehicles", str(int(self._vehicles.value or 1))]
        words += ["--detector", self._detector.value]
        if self._camera.value:
            words += ["--camera", self._camera.value]
        self._visitor.run(words)

    def _show_plan(self, words: Sequence[str]) -> None:
        """Show the plan of a new mission."""
        name = words[words.index("--out") + 1]
        picture = name.removesuffix(".toml") + ".png"
        self.plan.clear()
        with self.plan:
            ui.label(name).classes("app-title")
            if (self._visitor.app.workspace.folder / picture).is_file():
                ui.html(f'<img src="{self._visitor.file_url(picture)}" alt="plan of {name}">')
