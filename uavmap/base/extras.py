"""How a missing extra is installed where this uavmap runs: no package index has uavmap itself."""

from __future__ import annotations

import shlex
import sys
from importlib import metadata


def install_command(extra: str) -> str:
    """The command that installs the packages of an extra, ready to be pasted into a shell.

    >>> install_command("fast").partition(" -m ")[2]
    "pip install 'numba>=0.61'"
    """
    try:
        required = metadata.requires("uavmap") or []
    except metadata.PackageNotFoundError:  # run from its source, installed nowhere
        return f"pip install -e '.[{extra}]' in the folder with the source of uavmap"
    packages = [
        package
        for package, _, marker in (line.partition(";") for line in required)
        if marker.replace("'", '"').strip() == f'extra == "{extra}"'
    ]
    return shlex.join([sys.executable, "-m", "pip", "install", *map(str.strip, packages)])
