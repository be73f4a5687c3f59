"""The maps beneath the drawing: files of the user and mosaics of earlier flights in a folder."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import Final, NamedTuple

from missions.errors import UavmapError
from uavmap.output.drawing.mosaic_file import MOSAIC, ORTHO
from uavmap.ui.app.workspace import Workspace
from uavmap.ui.ground.layer import ENDINGS, GroundLayer, open_layer

_MAX_OPEN: Final = 12


class Facts(NamedTuple):
    """The facts about a map that a page needs before it requests tiles."""

    zooms: range
    attribution: str
    middle: tuple[float, float]
    """Latitude and longitude, degrees."""


class Grounds:
    """The maps of a folder, and one from another folder, by name; they are opened on demand."""

    def __init__(self, workspace: Workspace, given: Path | None = None) -> None:
        self._workspace = workspace
        self._given = given
        self._open: dict[str, tuple[int, GroundLayer]] = {}
        """Open maps by name, each with the time of its last change, ns."""
        self._lock = threading.Lock()
        """Lock for the layers: only one thread at a time may read one."""
        if given is not None:
            self.facts(str(given))

    def files(self) -> list[str]:
        """Return the names of map files; the one from another folder is first."""
        found = sorted(
            path.name
            for path in self._workspace.folder.iterdir()
            if path.suffix.lower() in ENDINGS and path.is_file() and path.suffix != ".webp"
        )
        return [*([] if self._given is None else [str(self._given)]), *found]

    def mosaics(self) -> list[str]:
        """Return the names of the mosaics of flights and replays; the newest is first."""
        found = []
        for flown in self._workspace.results():
            there = [name for name in (ORTHO, MOSAIC) if (flown.folder / name).is_file()]
            found += [f"{flown.name}/{name}" for name in there[:1]]
        return found

    def path_of(self, name: str) -> Path:
        """Return the path of a map. Raises `UavmapError` for one outside of the folder."""
        own = self._given is not None and name == str(self._given)
        return Path(name) if own else self._workspace.path_of(name)

    def facts(self, name: str) -> Facts:
        """Return the facts about a map. Raises `UavmapError` for another file."""
        with self._lock:
            layer = self._layer(name)
            return Facts(layer.zooms, layer.attribution, layer.middle)

    def tile(self, name: str, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile of a map; None if there is none."""
        with contextlib.suppress(UavmapError, OSError, ValueError), self._lock:
            layer = self._layer(name)
            if zoom in layer.zooms and 0 <= x < 2**zoom and 0 <= y < 2**zoom:
                return layer.tile(zoom, x, y)
        return None

    def _layer(self, name: str) -> GroundLayer:
        """Return a map, opened again if its file has changed; the last ones stay open."""
        path = self.path_of(name)
        try:
            written_ns = path.stat().st_mtime_ns  # a flight replaces its mosaic
        except OSError as error:
            raise UavmapError(f"{name}: cannot be read: {error.strerror}") from None
        if name in self._open and self._open[name][0] != written_ns:
            self._open.pop(name)[1].close()
        if name not in self._open:
            if len(self._open) >= _MAX_OPEN:
                self._open.pop(next(iter(self._open)))[1].close()
            self._open[name] = written_ns, open_layer(path)
        return self._open[name][1]
