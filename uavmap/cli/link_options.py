"""Options of the commands that speak to vehicles: the signing key, ground stations beside us."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Final

from missions.errors import LinkError

KEY_VARIABLE: Final = "UAVMAP_KEY_FILE"


def add_key_option(parser: argparse.ArgumentParser) -> None:
    """Add `--key`."""
    parser.add_argument(
        "--key",
        metavar="FILE",
        help="sign what is sent with the key in FILE, and believe only what is signed with it "
        f"(default: the file that {KEY_VARIABLE} names; `uavmap keys new FILE` makes one)",
    )


def add_link_options(parser: argparse.ArgumentParser) -> None:
    """Add `--key` and `--forward`."""
    add_key_option(parser)
    parser.add_argument(
        "--forward",
        metavar="URL",
        action="append",
        help="pass all frames of the vehicles on to a ground station there, and its frames to "
        "them; may be repeated",
    )


def key_file(options: argparse.Namespace) -> str | None:
    """The file of the key as an absolute path, None without one. Raises `LinkError`."""
    given = options.key if options.key is not None else os.environ.get(KEY_VARIABLE) or None
    if given is None:
        return None
    if not given:
        raise LinkError("--key is empty; name the file of a key")
    return str(Path(given).expanduser().absolute())
