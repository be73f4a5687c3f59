"""What was set on the autopilots before a flight, on disk until it is put back.

Should this computer die in the flight, `uavmap resume` finds it there.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from missions.errors import OutputError
from missions.units import LatLon
from uavmap.base.atomic_write import write_text
from uavmap.mavlink.mission_transfer import Item
from uavmap.mavlink.parameters import Parameter

FILE: Final = "autopilot-before.json"


@dataclass(frozen=True, slots=True)
class Before:
    """What one autopilot had."""

    parameters: dict[str, Parameter]
    fence: tuple[Item, ...]
    rally: tuple[Item, ...]


class Kept:
    """The file in a results folder, by the vehicles' numbers."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE

    def of(self, number: int) -> Before | None:
        """What the autopilot of a vehicle had; None where nothing is to be put back.

        Raises `OutputError` where the file is not one of ours.
        """
        values = self._read().get(str(number))
        if values is None:
            return None
        try:
            return Before(
                {name: Parameter(float(v), int(t)) for name, (v, t) in values["set"].items()},
                _items(values["fence"]),
                _items(values["rally"]),
            )
        except (KeyError, TypeError, ValueError):
            raise self._unreadable() from None

    def keep(self, number: int, before: Before) -> None:
        """Note it, before anything is changed. Raises `OutputError`."""
        values = self._read()
        values[str(number)] = {
            "set": {name: [p.value, p.type] for name, p in before.parameters.items()},
            "fence": [_plain(item) for item in before.fence],
            "rally": [_plain(item) for item in before.rally],
        }
        self._write(values)

    def done(self, number: int) -> None:
        """It is put back. Raises `OutputError`."""
        values = self._read()
        if values.pop(str(number), None) is not None:
            self._write(values)

    def _read(self) -> dict[str, Any]:
        try:
            values = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError):
            raise self._unreadable() from None
        if not isinstance(values, dict):
            raise self._unreadable()
        return values

    def _unreadable(self) -> OutputError:
        return OutputError(
            f"{self.path} cannot be read; it says what was set on the autopilots before the "
            "flight: set that by hand, and remove the file"
        )

    def _write(self, values: dict[str, Any]) -> None:
        try:
            if values:
                write_text(self.path, json.dumps(values, indent=1) + "\n")
            else:
                self.path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path} cannot be written: {error.strerror}") from None


def _plain(item: Item) -> list[float]:
    place = item.position
    return [item.command, item.frame, item.first, place.lat_deg, place.lon_deg, item.height_m]


def _items(rows: list[list[float]]) -> tuple[Item, ...]:
    return tuple(
        Item(int(command), LatLon(lat, lon), first, int(frame), height)
        for command, frame, first, lat, lon, height in rows
    )
