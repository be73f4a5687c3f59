"""What an operator orders of a flight, by signals, keys, or the page."""

from __future__ import annotations

from typing import Any, Protocol


class Steered(Protocol):
    """A service, as an operator steers it."""

    @property
    def state(self) -> Any:
        """What the mission knows: `vehicles` by their numbers."""
        ...

    @property
    def flying(self) -> bool:
        """Whether the flight has begun, and is not over."""
        ...

    def pause(self) -> bool:
        """Have all vehicles hold."""
        ...

    def go_on(self) -> bool:
        """End a pause."""
        ...

    def recall(self) -> None:
        """Call all vehicles home."""
        ...

    def recall_vehicle(self, number: int) -> bool:
        """Call one vehicle home."""
        ...

    def skip_cell(self, number: int) -> bool:
        """Leave out the cell that a vehicle observes, or is to observe."""
        ...

    def land_here(self, number: int) -> bool:
        """Have a vehicle land where it is."""
        ...
