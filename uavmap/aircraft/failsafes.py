"""Failsafes by name: which of a vehicle's words say why its autopilot flies by itself."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

_BY_THEMSELVES: Final = ("RTL", "SMART_RTL", "LAND", "BRAKE", "ALT_HOLD", "HOLD", "RETURN")
"""Modes into which a failsafe puts a vehicle. LOITER, STABILIZE and the like are a pilot's."""
_OVER: Final = re.compile(r"clear|regain|recover|restored|resolved|passed", re.IGNORECASE)
_NAMES: Final = tuple(
    (name, re.compile(words, re.IGNORECASE))
    for name, words in (
        # ArduPilot's words, and PX4's
        ("battery failsafe", r"batt\w* .*(low|critical|emergency|failsafe|unhealthy)|batt\w* fail"
         r"|(low|critical|emergency|dangerous\w*)\b.* battery|battery .*(return|land)"),
        ("fence breached", r"fence.*breach|breach.*fence|geofence (violation|breach|exceeded)"
         r"|(maximum|max) (altitude|distance).*(exceeded|breach)"),
        ("EKF failsafe", r"ekf (failsafe|variance)|ekf.*(fault|unhealthy)"),
        ("GPS glitch", r"gps glitch|gnss (data|signal).*lost|no valid (global )?position"
         r"|(global )?position (estimate )?(lost|invalid)|dead ?reckon\w* failsafe"),
        ("radio failsafe", r"(radio|throttle|rc)\b.* failsafe|(manual|radio|rc) control.* lost"
         r"|rc (signal )?lost"),
        ("ground station failsafe", r"gcs.* failsafe"
         r"|(gcs|ground ?(control )?station|data ?link).* lost"),
        ("vibration failsafe", r"vibration (failsafe|compensation)"),
        ("terrain failsafe", r"terrain.* failsafe"),
        ("thrust loss", r"thrust loss|motor (failure|fault)"),
        ("crash check", r"^crash\b|crash:"),
        ("failsafe", r"failsafe"),
    )
)  # fmt: skip


def failsafe_of(words: Iterable[str]) -> str | None:
    """The failsafe that a vehicle's latest words name, with the words; None where they name none.

    >>> failsafe_of(["Battery 1 is low 9.90V used 31 mAh", "Battery Failsafe"])
    'battery failsafe: Battery 1 is low 9.90V used 31 mAh'
    >>> failsafe_of(["Fence Breached"]), failsafe_of(["GPS Glitch cleared", "Mission: 1 WP"])
    ('fence breached', None)
    """
    told = [text for text in words if text and not _OVER.search(text)]
    for name, pattern in _NAMES:
        found = [text for text in told if pattern.search(text)]
        if not found:
            continue
        most = max(found, key=len)
        return name if most.casefold().rstrip(".!") == name.casefold() else f"{name}: {most}"
    return None


def may_be_a_failsafe(mode_name: str) -> bool:
    """Whether a failsafe may have brought about a mode.

    >>> [may_be_a_failsafe(mode) for mode in ("RTL", "HOLD by a failsafe", "LOITER")]
    [True, True, False]
    """
    return "failsafe" in mode_name or mode_name in _BY_THEMSELVES
