"""Packages that are extras: the command that installs one, and the client of Dask."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from importlib import import_module, metadata
from typing import Any, Final

from missions.errors import StudyError

ANSWER_S: Final = 10.0
"""Maximum time of a Dask scheduler's answer, real seconds."""


def install_command(extra: str) -> str:
    """Return the command that installs the packages of an extra, ready to be pasted into a shell.

    >>> install_command("fast").partition(" -m ")[2]
    "pip install 'numba>=0.61'"
    """
    try:
        required = metadata.requires("uavmap") or []
    except metadata.PackageNotFoundError:  # run from its source, without installation
        return f"pip install -e '.[{extra}]' in the folder with the source of uavmap"
    packages = [
        package
        for package, _, marker in (line.partition(";") for line in required)
        if marker.replace("'", '"').strip() == f'extra == "{extra}"'
    ]
    return shlex.join([sys.executable, "-m", "pip", "install", *map(str.strip, packages)])


def dask_client(
    address: str, answer_s: float | None = None, load: Callable[[str], Any] = import_module
) -> Any:
    """Return a client of the scheduler at `tcp://HOST:PORT`.

    Raises `StudyError` without Dask, for another address, and without an answer within `answer_s`.
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
