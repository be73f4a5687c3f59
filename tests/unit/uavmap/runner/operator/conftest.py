"""A terminal for tests of the operator."""

import contextlib
import os
import pty

import pytest


@pytest.fixture
def terminal():
    """Open a terminal; yield the operator's end and the program's."""
    operator, ours = pty.openpty()
    stream = os.fdopen(ours, "r")
    yield operator, stream
    stream.close()
    with contextlib.suppress(OSError):  # a test may have hung up
        os.close(operator)
