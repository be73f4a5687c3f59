"""A terminal for tests of the operator."""

from __future__ import annotations

import contextlib
import os
import pty
from collections.abc import Iterator
from typing import TextIO

import pytest


@pytest.fixture
def terminal() -> Iterator[tuple[int, TextIO]]:
    """The operator's end of a terminal, and ours."""
    operator, ours = pty.openpty()
    stream = os.fdopen(ours, "r")
    yield operator, stream
    stream.close()
    with contextlib.suppress(OSError):  # a test may have hung up
        os.close(operator)
