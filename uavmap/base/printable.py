"""Foreign text (a status text, a URL), made safe to show: one line, of bounded length.

It has no escape sequences for a terminal, control characters or bidi marks.
"""

from __future__ import annotations

import re
from typing import Final

TEXT_LIMIT: Final = 300

# CSI (ESC [ or C1 0x9b) to its final byte, OSC and its kin to their terminator, other ESC pairs
_SEQUENCE: Final = re.compile(
    r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]?"
    r"|(?:\x1b[\]PX^_]|[\x90\x98\x9d\x9e\x9f])[^\x07\x1b\x9c]*(?:\x07|\x1b\\|\x9c)?"
    r"|\x1b[ -/]*[0-~]?"
)
_BREAK: Final = re.compile(r"[\t\n\v\f\r\x85\u2028\u2029]+")


def printable(text: str, limit: int = TEXT_LIMIT) -> str:
    r"""Return the text in one line, without escape sequences, control, format and bidi characters.

    Text longer than `limit` characters is cut and ends in "...".

    >>> printable("\x1b]0;owned\x07PreArm: \x1b[31mBattery\x1b[0m\r\n low")
    'PreArm: Battery  low'
    >>> printable("abc\u202efdp.exe\x9b2J")
    'abcfdp.exe'
    >>> printable("x" * 10, limit=8)
    'xxxxx...'
    """
    # the end of a text of megabytes need not be read
    head = text[: 8 * limit + 64]
    line = _BREAK.sub(" ", _SEQUENCE.sub("", head))
    # `isprintable` is false for control, format, surrogate, private and unassigned characters
    line = "".join(char for char in line if char.isprintable())
    return line if len(line) <= limit else line[: max(limit - 3, 0)] + "..."
