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


def check_number(key: str, value: object, least: float, most: float) -> None:
    """Raise `MissionFileError`, naming the key, unless a parameter is a number in a range.

    >>> check_number("softness", 3, 0.0, 2.0)
    Traceback (most recent call last):
    missions.errors.MissionFileError: detector.softness is 3: expected a number from 0 to 2
    """
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not least <= value <= most:  # type: ignore[operator]
        raise MissionFileError(
            f"detector.{key} is {value!r}: expected a number from {least:g} to {most:g}"
        )


def check_polarity(value: object) -> None:
    """Raise `MissionFileError` unless a polarity is "dark" or "bright".

    >>> check_polarity("grey")
    Traceback (most recent call last):
    missions.errors.MissionFileError: detector.polarity is 'grey': expected 'dark' or 'bright'
    """
    if value not in ("dark", "bright"):
        raise MissionFileError(f"detector.polarity is {value!r}: expected 'dark' or 'bright'")
