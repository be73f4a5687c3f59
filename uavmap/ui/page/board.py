"""The content of the page at an instant, and its changes since an earlier version. Pure.

A board has cells with the number of their state, a record for each vehicle, lines of a log, and
fields of the flight. Each has a stamp. `since` returns all that was stamped after a version, so a
slow browser gets fewer updates, and each change once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, Final

Delta = dict[str, Any]
"""The changes from a version of a board (`since`) to a later one (`v`), for `json.dumps`.

If `since` is 0, it is a snapshot. `cells` is flat: column, row, state, column, ... `tracks` has
east, north, ... by vehicle. `log` has lines of number, mission time in s, level and text.
"""

MAX_LINES: Final = 300
"""Maximum number of lines of the log."""
MAX_POINTS: Final = 3000
"""Maximum number of points of a vehicle's track."""

Place = tuple[int, int]
Line = tuple[int, float, str, str]


class Board:
    """The content of the page of a flight.

    >>> board, copy = Board(), Board()
    >>> board.set_cell((3, -2), 1)
    >>> board.set_field("phase", "searching")
    >>> board.commit()
    True
    >>> copy.apply(board.since(0))
    >>> board.set_cell((3, -2), 4)
    >>> board.commit()
    True
    >>> board.since(1)["cells"]
    [3, -2, 4]
    >>> copy.apply(board.since(1))
    >>> copy.since(0) == board.since(0)
    True
    """

    def __init__(self) -> None:
        self.version = 0
        self._cells: dict[Place, tuple[int, int]] = {}
        """Number of the state and stamp of each cell, in the order of the stamps."""
        self._fields: dict[str, tuple[Any, int]] = {}
        self._vehicles: dict[int, tuple[Mapping[str, Any], int]] = {}
        self._tracks: dict[int, deque[tuple[int, float, float]]] = {}
        self._log: deque[tuple[int, Line]] = deque(maxlen=MAX_LINES)
        self._lines = 0
        self._changed = False

    # --- content ---------------------------------------------------------------------------
    @property
    def cells(self) -> dict[Place, int]:
        """The number of each cell's state."""
        return {cell: code for cell, (code, _) in self._cells.items()}

    @property
    def vehicles(self) -> tuple[int, ...]:
        """The numbers of the vehicles."""
        return tuple(self._vehicles)

    def field(self, name: str) -> Any:
        """Return a field of the flight; None if it is not set."""
        return self._fields.get(name, (None, 0))[0]

    def cell(self, place: Place) -> int | None:
        """Return the number of a cell's state; None if no frame shows the cell."""
        found = self._cells.get(place)
        return None if found is None else found[0]

    # --- changes ---------------------------------------------------------------------------
    @property
    def _stamp(self) -> int:
        self._changed = True
        return self.version + 1

    def set_cell(self, place: Place, code: int) -> None:
        """Set the state of a cell by its number."""
        before = self._cells.get(place)
        if before is None or before[0] != code:
            self._put_cell(place, code, self._stamp)

    def set_field(self, name: str, value: Any) -> None:
        """Set a field of the flight; `value` is for JSON."""
        if name not in self._fields or self._fields[name][0] != value:
            self._fields[name] = (value, self._stamp)

    def set_vehicle(self, number: int, record: Mapping[str, Any]) -> None:
        """Set the record of one vehicle."""
        before = self._vehicles.get(number)
        if before is None or before[0] != record:
            self._vehicles[number] = (record, self._stamp)

    def add_point(self, number: int, east_m: float, north_m: float) -> None:
        """Append a point to the track of a vehicle, m in the grid's moving frame."""
        self._track(number).append((self._stamp, east_m, north_m))

    def add_line(self, t_s: float, level: str, text: str) -> None:
        """Add a line to the log."""
        self._lines += 1
        self._log.append((self._stamp, (self._lines, t_s, level, text)))

    def commit(self) -> bool:
        """Make a version of all changes; return False if there are none."""
        changed, self._changed = self._changed, False
        self.version += changed
        return changed

    # --- deltas ----------------------------------------------------------------------------
    def since(self, version: int) -> Delta:
        """Return the changes after a version, committed or not; for 0 a snapshot."""
        self.commit()
        return {
            "v": self.version,
            "since": version,
            "cells": [
                part for place, code in self._cells_since(version) for part in (*place, code)
            ],
            "fields": {k: v for k, (v, stamp) in self._fields.items() if stamp > version},
            "vehicles": {
                str(number): dict(record)
                for number, (record, stamp) in sorted(self._vehicles.items())
                if stamp > version
            },
            "tracks": {
                str(number): points
                for number, track in sorted(self._tracks.items())
                if (points := _points_since(track, version))
            },
            "log": [list(line) for stamp, line in self._log if stamp > version],
        }

    def apply(self, delta: Delta) -> None:
        """Apply a snapshot, or a delta since this version. Raises `ValueError` for another."""
        since, stamp = delta["since"], delta["v"]
        if since not in (0, self.version):
            raise ValueError(f"a delta since {since} does not follow version {self.version}")
        if since == 0:
            self.__init__()  # type: ignore[misc]
        flat = iter(delta["cells"])
        for place in zip(flat, flat, flat, strict=True):
            self._put_cell((place[0], place[1]), place[2], stamp)
        for name, value in delta["fields"].items():
            self._fields[name] = (value, stamp)
        for number, record in delta["vehicles"].items():
            self._vehicles[int(number)] = (record, stamp)
        for number, points in delta["tracks"].items():
            track, coordinates = self._track(int(number)), iter(points)
            track.extend((stamp, e, n) for e, n in zip(coordinates, coordinates, strict=True))
        for line in delta["log"]:
            self._log.append((stamp, tuple(line)))
            self._lines = line[0]
        self.version, self._changed = stamp, False

    def _put_cell(self, place: Place, code: int, stamp: int) -> None:
        self._cells.pop(place, None)  # to the end: the order is that of the stamps
        self._cells[place] = (code, stamp)

    def _cells_since(self, version: int) -> list[tuple[Place, int]]:
        found = []
        for place, (code, stamp) in reversed(self._cells.items()):
            if stamp <= version:
                break
            found.append((place, code))
        return found[::-1]

    def _track(self, number: int) -> deque[tuple[int, float, float]]:
        return self._tracks.setdefault(number, deque(maxlen=MAX_POINTS))


def _points_since(track: deque[tuple[int, float, float]], version: int) -> list[float]:
    def newest() -> Iterator[float]:
        for stamp, east_m, north_m in reversed(track):
            if stamp <= version:
                return
            yield north_m
            yield east_m

    return list(newest())[::-1]
