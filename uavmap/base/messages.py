"""Lines for the operator: records of the loggers below `uavmap`, at level INFO.

    logging.getLogger("uavmap.fleet").info("the radio is silent")

    with shown_on(Terminal()):
        ...  # shows what is logged here, or in a task that is started here

A program may run several flights at once, in threads or tasks. A line is shown on the displays of
the context (`contextvars`) in which it is logged. An object that is called from other contexts
logs by a logger that was `bound` where the object was made.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Iterator, MutableMapping
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

_ALL: Final = logging.getLogger("uavmap")
_CHANGES: Final = threading.Lock()


class Display(Protocol):
    """Shows lines to an operator."""

    def show(self, text: str) -> None:
        """Show a line, or several. Never raises."""


@dataclass(frozen=True, slots=True)
class _Source:
    """Source of a line: `scope` is one for all that share displays."""

    scope: object
    prefix: str = ""


_SOURCE: Final[ContextVar[_Source | None]] = ContextVar("source", default=None)


class _Shower(logging.Handler):
    """Shows the lines of one scope, and those of no scope, on a display."""

    def __init__(self, display: Display, scope: object) -> None:
        super().__init__(logging.INFO)
        self._display = display
        self._scope = scope

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record."""
        source: _Source | None = getattr(record, "source", None) or _SOURCE.get()
        if source is None or source.scope is self._scope:
            self._display.show((source.prefix if source else "") + record.getMessage())


@contextlib.contextmanager
def shown_on(*displays: Display) -> Iterator[None]:
    """Show the lines of this context on the displays, and on those of an outer `shown_on`."""
    source = _SOURCE.get() or _Source(object())
    showers = [_Shower(display, source.scope) for display in displays]
    with _logging_as(source):
        _change(showers, [])
        try:
            yield
        finally:
            _change([], showers)


def muted() -> AbstractContextManager[None]:
    """Show no line of this context."""
    return _logging_as(_Source(object()))


def prefixed(prefix: str) -> AbstractContextManager[None]:
    """Begin the lines of this context with a prefix, such as `vehicle 2: `."""
    return _logging_as(replace(_SOURCE.get() or _Source(object()), prefix=prefix))


@contextlib.contextmanager
def _logging_as(source: _Source) -> Iterator[None]:
    token = _SOURCE.set(source)
    try:
        yield
    finally:
        _SOURCE.reset(token)


class _Bound(logging.LoggerAdapter[logging.Logger]):
    """Logs for the context in which it was made, from any caller."""

    def __init__(self, name: str) -> None:
        super().__init__(logging.getLogger(name), {"source": _SOURCE.get()})

    def process(
        self, msg: Any, kwargs: MutableMapping[str, Any]
    ) -> tuple[Any, MutableMapping[str, Any]]:
        """Add the source."""
        return msg, {**kwargs, "extra": self.extra}

    def line(self, text: str) -> None:
        """Log a line; an aircraft gets this as its function of a text."""
        self.info(text)


def bound(name: str) -> _Bound:
    """Make a logger that belongs to the present context."""
    return _Bound(name)


def _change(add: list[_Shower], remove: list[_Shower]) -> None:
    """Add and remove handlers; nothing is logged at INFO unless it is shown."""
    with _CHANGES:
        for shower in add:
            _ALL.addHandler(shower)
        for shower in remove:
            _ALL.removeHandler(shower)
        shows = any(isinstance(handler, _Shower) for handler in _ALL.handlers)
        _ALL.setLevel(logging.INFO if shows else logging.NOTSET)
