"""A file with an area, from any of the supported tools."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path

from missions.errors import AreaError
from uavmap.base.text_files import read_bytes
from uavmap.load.areas.drawing import MAX_BYTES, Area, Drawing, Layer, bounded_together, in_wgs84
from uavmap.load.areas.formats import AreaFile, layers_of


def read_area_file(name: str, *, epsg: int | None = None, swap: bool = False) -> Drawing:
    """Read the drawing in a file, in WGS84.

    The content decides on the kind of file; the suffix decides only between similar kinds.

    Args:
        name: Path of the file.
        epsg: EPSG number for a file that names no coordinate system.
        swap: Exchange latitude and longitude.

    Raises:
        AreaError: The file cannot be read; the message has file, fault and remedy.
    """
    path = Path(name)
    try:
        data = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise AreaError(f"{name}: cannot be read ({error.strerror}){_guess(path)}") from None
    except ValueError:
        raise AreaError(f"{name!r}: not a name of a file") from None
    if not data.strip():
        raise AreaError(f"{name}: is empty; save the area anew")
    layers: list[Layer] = []
    for layer in layers_of(AreaFile(path, data, name)):
        layers.append(layer)
        bounded_together(layers, name)
    drawing = in_wgs84(layers, name, given=epsg, swap=swap)
    if drawing.areas:
        return drawing
    if not drawing.fences:
        why = f" ({drawing.notices[0]})" if drawing.notices else ""
        raise AreaError(f"{name}: holds no polygon{why}; draw the area as a closed polygon")
    return replace(
        drawing,
        areas=tuple(Area(f"inside of {one.name}", one.ring) for one in drawing.fences),
        notices=(*drawing.notices, "no area, but a fence: the area is the inside of the fence"),
    )


def _guess(path: Path) -> str:
    try:
        names = [one.name for one in path.parent.iterdir()] if path.parent.is_dir() else []
    except OSError:
        names = []
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"; did you mean {str(path.with_name(near[0]))!r}?" if near else ""
