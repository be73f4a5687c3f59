"""The installation: Python, packages, compiled planning, disk, picture formats."""

from __future__ import annotations

import importlib.metadata
import platform
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from uavmap.base.extras import install_command
from uavmap.base.version import __version__
from uavmap.runner.preflight.finding import Finding, bad, ok, warn

PYTHON: Final = (3, 11)
LITTLE_DISK_B: Final = 200 * 2**20
"""A flight of an hour leaves a journal and a telemetry log of some ten megabytes."""
NO_DISK_B: Final = 20 * 2**20
NEEDED: Final = (
    "numpy",
    "opencv-python-headless",
    "pillow",
    "pydantic",
    "pymavlink",
    "pyproj",
    "pyserial",
    "rich",
    "shapely",
)


def installation(folder: Path) -> Iterator[Finding]:
    """What this computer has; `folder` is where results go."""
    yield from _python()
    yield from _packages()
    yield _compiled()
    yield _disk(folder)
    yield from _formats()


def _python() -> Iterator[Finding]:
    found = f"{platform.python_version()} on {platform.machine()}, uavmap {__version__}"
    if sys.version_info >= PYTHON:
        yield ok("Python", found)
    else:
        wanted = ".".join(map(str, PYTHON))
        yield bad("Python", found, f"{wanted} or newer", "install a newer Python")


def _packages() -> Iterator[Finding]:
    versions, missing = [], []
    for name in NEEDED:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        names = ", ".join(missing)
        yield bad("packages", f"missing: {names}", "all of them", f"pip install {names}")
    yield ok("packages", ", ".join(versions))


def _compiled() -> Finding:
    from missions.planning.kernels.jit import COMPILED  # noqa: PLC0415 - numba takes a second

    if COMPILED:
        return ok("planning", f"compiled (numba {importlib.metadata.version('numba')})")
    return warn(
        "planning",
        "not compiled: numba is not installed",
        "numba",
        f"{install_command('fast')}; strategies that stop do without",
    )


def _disk(folder: Path) -> Finding:
    there = folder.absolute()
    while not there.exists():
        there = there.parent
    free_b = shutil.disk_usage(there).free
    found = f"{free_b / 2**20:.0f} MB free at {there}"
    if free_b < NO_DISK_B:
        return bad("disk", found, f"{LITTLE_DISK_B // 2**20} MB", "make room")
    if free_b < LITTLE_DISK_B:
        return warn("disk", found, f"{LITTLE_DISK_B // 2**20} MB", "make room before a long flight")
    return ok("disk", found)


def _formats() -> Iterator[Finding]:
    """A picture in each format that is read or written, there and back."""
    picture = np.full((16, 16, 3), 90, np.uint8)
    broken = []
    for suffix in (".jpg", ".png"):
        done, data = cv2.imencode(suffix, picture)
        if not done or cv2.imdecode(data, cv2.IMREAD_COLOR) is None:
            broken.append(suffix)
    if broken:
        yield bad(
            "picture formats",
            f"this OpenCV has no {' and '.join(broken)}",
            "JPEG and PNG",
            "pip install --force-reinstall opencv-python-headless",
        )
    else:
        yield ok("picture formats", "JPEG and PNG can be read and written")
