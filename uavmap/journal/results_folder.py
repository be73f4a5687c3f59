"""The folder for the results of a flight or a replay."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from missions.errors import JournalError, OutputError
from uavmap.journal.flight_plan import JOURNAL

RESULTS: Final = "results"


def results_folder(out: str | None, name: str) -> Path:
    """Return the folder for a run: the given one, or a new one under `results`.

    Raises `JournalError` when it holds a mission already: nothing is ever overwritten.
    """
    if out is not None:
        if not out:
            raise JournalError("--out is empty; name a folder")
        folder = Path(out)
        if folder.exists() and not folder.is_dir():
            raise JournalError(f"--out {folder} is a file, not a folder")
        if (folder / JOURNAL).exists():
            raise JournalError(
                f"--out {folder} holds a mission already; go on with `uavmap resume {folder}`, "
                "or choose another folder"
            )
        return folder
    for number in range(1, 10_000):
        folder = Path(RESULTS) / f"{folder_name(name)}-{number}"
        if not folder.exists():
            return folder
    raise JournalError(f"{RESULTS} is full; give --out")


def folder_name(name: str) -> str:
    """Return the name of a mission as that of a folder: never a path to another place.

    >>> folder_name("../../up"), folder_name("field 7"), folder_name("")
    ('______up', 'field 7', 'mission')
    """
    kept = "".join(c if c.isalnum() or c in " -_" else "_" for c in name)
    return kept.encode()[:200].decode(errors="ignore") or "mission"


def make_folder(folder: Path) -> None:
    """Make the folder of --out, and those above it, unless it exists. Raises `OutputError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"--out {folder} cannot be made: {error.strerror}") from None


def refuse_unwritable(folder: Path) -> None:
    """Raise `OutputError` if a folder cannot be written in, or not be made; make none."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise OutputError(f"--out {folder} cannot be made: {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f"--out {folder}: {there} cannot be written in; choose another folder")
