"""A question to the operator at the terminal, without holding up the links meanwhile."""

from __future__ import annotations

import logging
import sys
from typing import Final, TextIO

from uavmap.base.terminal import forget_typed, read_line

_LOG: Final = logging.getLogger("uavmap.runner.preflight")


class Operator:
    """The operator at the terminal, if there is one."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream: TextIO | None = stream or sys.stdin

    @property
    def absent(self) -> bool:
        """Whether nobody will ever answer."""
        return self._stream is None or not self._stream.isatty()

    async def agrees(self, question: str) -> bool:
        """Ask, and wait for a line; whether it is a yes."""
        forget_typed(self._stream)
        _LOG.info(question)
        return (await read_line(self._stream)).strip().lower() in ("y", "yes")
