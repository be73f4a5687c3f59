"""The lines for the operator: a display that keeps them, and a stream that fails."""

from __future__ import annotations

import io


class ShownLines(list[str]):
    def show(self, text: str) -> None:
        self.append(text)

    @property
    def page(self) -> str:
        """Return the URL of the live page."""
        named = "live page: "
        return next(line.removeprefix(named) for line in self if line.startswith(named))


class BrokenStream(io.StringIO):
    """A terminal, a pipe or a disk that accepts no more data."""

    def __init__(self, failure: Exception, *, terminal: bool = False) -> None:
        super().__init__()
        self._failure = failure
        self._terminal = terminal
        self.tried = 0

    def isatty(self) -> bool:
        return self._terminal

    def write(self, text: str) -> int:
        self.tried += 1
        raise self._failure

    def flush(self) -> None:
        raise self._failure
