"""What was set on the autopilots before a flight, on disk until it is put back.

`uavmap resume` finds it there, if this computer dies in the flight or the putting back fails.
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
    """What one autopilot had; None: its lists are left alone."""

    parameters: dict[str, Parameter]
    fence: tuple[Item, ...] | None = None
    rally: tuple[Item, ...] | None = None


class Kept:
    """The file in a results folder, by the identity of the aircraft.

    Another aircraft in the place of one that crashed has an entry of its own.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE

    @property
    def empty(self) -> bool:
        """Whether nothing is to be put back."""
        return not self.path.exists()

    def of(self, aircraft: str) -> Before | None:
        """What the autopilot of an aircraft had; None where nothing is to be put back.

        Raises `OutputError` where the file is not one of ours.
        """
        values = self._read().get(aircraft)
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

    def keep(self, aircraft: str, number: int, before: Before) -> None:
        """Note it of the aircraft that flies as vehicle `number`, before anything is changed.

        Raises `OutputError`.
        """
        values = self._read()
        values[aircraft] = {
            "vehicle": number,
            "set": {name: [p.value, p.type] for name, p in before.parameters.items()},
            "fence": _plain(before.fence),
            "rally": _plain(before.rally),
        }
        self._write(values)

    def done(self, aircraft: str) -> None:
        """It is put back. Raises `OutputError`."""
        values = self._read()
        if values.pop(aircraft, None) is not None:
            self._write(values)

    def in_place_of(self, number: int) -> list[str]:
        """The aircraft that flew as vehicle `number`, and are not yet as found.

        Raises `OutputError`.
        """
        return [key for key, value in self._read().items() if value.get("vehicle") == number]

    def _read(self) -> dict[str, Any]:
        try:
            values = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError):
            raise self._unreadable() from None
        if not isinstance(values, dict) or not all(isinstance(v, dict) for v in values.values()):
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


def _plain(items: tuple[Item, ...] | None) -> list[list[float]] | None:
    if items is None:
        return None
    return [
        [i.command, i.frame, i.first, i.position.lat_deg, i.position.lon_deg, i.height_m]
        for i in items
    ]


def _items(rows: list[list[float]] | None) -> tuple[Item, ...] | None:
    if rows is None:
        return None
    return tuple(
        Item(int(command), LatLon(lat, lon), first, int(frame), height)
        for command, frame, first, lat, lon, height in rows
    )
