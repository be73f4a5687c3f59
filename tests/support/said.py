"""The lines for the operator, as a display that keeps them."""

from __future__ import annotations


class Said(list[str]):
    """Lines that were shown."""

    def show(self, text: str) -> None:
        self.append(text)
