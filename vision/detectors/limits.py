"""What the parameters of a detector may be."""

from __future__ import annotations

from missions.errors import MissionFileError


def check_whole(key: str, value: object, most: int) -> None:
    """Raise `MissionFileError`, naming the key, unless a parameter is an integer from 0 to `most`.

    >>> check_whole("dilations", -1, 255)
    Traceback (most recent call last):
    missions.errors.MissionFileError: detector.dilations is -1: expected an integer from 0 to 255
    """
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise MissionFileError(f"detector.{key} is {value!r}: expected an integer from 0 to {most}")
