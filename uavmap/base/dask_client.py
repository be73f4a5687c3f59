"""The way to a Dask cluster (`--scheduler`), which is an extra."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Final

from missions.errors import StudyError
from uavmap.base.extras import install_command

ANSWER_S: Final = 10.0


def dask_client(
    address: str, answer_s: float | None = None, load: Callable[[str], Any] = import_module
) -> Any:
    """Yield a client of the scheduler at `tcp://HOST:PORT`.

    Raises `StudyError` without Dask, for no address, and without an answer within `answer_s`.
    """
    try:
        distributed: Any = load("distributed")
    except ImportError:
        raise StudyError(f"--scheduler needs Dask: {install_command('cluster')}") from None
    if not _is_address(address):  # Dask would wait for half a minute, and then complain at length
        raise StudyError(f"--scheduler {address!r}: expected tcp://HOST:PORT")
    try:
        return distributed.Client(address, timeout=answer_s or ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyError(f"--scheduler {address}: no Dask scheduler answers ({error})") from None


def _is_address(text: str) -> bool:
    scheme, _, rest = text.rpartition("://")
    host, _, port = rest.rpartition(":")
    whole = port.isascii() and port.isdigit() and len(port) < 6 and 0 < int(port) < 65536
    return scheme in ("", "tcp", "tls") and bool(host) and whole
