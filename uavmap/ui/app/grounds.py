"""The maps that lie in a folder, to be shown beneath: files of the user's own, earlier mosaics."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import Final

from missions.errors import UavmapError
from missions.units import LatLon
from uavmap.output.drawing.mosaic_file import MOSAIC, ORTHO
from uavmap.ui.app.workspace import Workspace
from uavmap.ui.ground.layer import ENDINGS, GroundLayer, opened, shows

_MOST_OPEN: Final = 12


class Grounds:
    """The maps of a folder, and one from elsewhere, by name; they are opened once asked for."""

    def __init__(self, workspace: Workspace, given: Path | None = None) -> None:
        self._workspace = workspace
        self._given = given
        self._open: dict[tuple[str, int], GroundLayer] = {}
        self._lock = threading.RLock()
        """A layer is read by one thread at a time."""
        if given is not None:
            self.layer(str(given))

    def files(self) -> list[str]:
        """Return the names of map files, the one that was given first."""
        found = sorted(
            path.name
            for path in self._workspace.folder.iterdir()
            if path.suffix.lower() in ENDINGS and path.is_file() and path.suffix != ".webp"
        )
        return [*([] if self._given is None else [str(self._given)]), *found]

    def mosaics(self) -> list[str]:
        """Return the names of the mosaics of flights and replays, the newest first."""
        found = []
        for flown in self._workspace.results():
            there = [name for name in (ORTHO, MOSAIC) if (flown.folder / name).is_file()]
            found += [f"{flown.name}/{name}" for name in there[:1]]
        return found

    def layer(self, name: str) -> GroundLayer:
        """Return an open map. Raises `UavmapError` for a file that is none."""
        own = self._given is not None and name == str(self._given)
        path = Path(name).absolute() if own else self._workspace.path_of(name)
        try:
            key = name, path.stat().st_mtime_ns  # a flight writes its mosaic anew
        except OSError as error:
            raise UavmapError(f"{name}: cannot be read: {error.strerror}") from None
        with self._lock:
            if key not in self._open:
                if len(self._open) >= _MOST_OPEN:
                    self._open.pop(next(iter(self._open))).close()
                self._open[key] = opened(path)
            return self._open[key]

    def tile(self, name: str, zoom: int, x: int, y: int) -> bytes | None:
        """Return a tile of a map; None where there is none."""
        with contextlib.suppress(UavmapError, OSError), self._lock:
            layer = self.layer(name)
            return layer.tile(zoom, x, y) if zoom in layer.zooms else None
        return None

    def beneath(self, place: LatLon) -> str | None:
        """Return the first map file that shows a place; None where none does."""
        for name in self.files():
            with contextlib.suppress(UavmapError, OSError), self._lock:
                if shows(self.layer(name), place):
                    return name
        return None
