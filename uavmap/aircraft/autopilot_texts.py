"""The texts of a vehicle: shown to the operator and kept in the journal, within limits.

A repeated text is counted: no vehicle fills the screen or the disk. Some texts name the failsafe by
which the autopilot flies.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from missions.events import CAUSE_NOT_REPORTED, AutopilotText
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.status_texts import CAUSELESS, DUE, Text

_BY_THEMSELVES: Final = ("RTL", "SMART_RTL", "LAND", "BRAKE", "ALT_HOLD", "HOLD", "RETURN")
"""Modes into which a failsafe puts a vehicle. LOITER, STABILIZE and the like are a pilot's."""
_OVER: Final = re.compile(r"clear|regain|recover|restored|resolved|passed", re.IGNORECASE)
_NAMES: Final = tuple(
    (name, re.compile(words, re.IGNORECASE))
    for name, words in (
        # texts of ArduPilot and of PX4
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
    """Return the failsafe that a vehicle's latest texts name, with the text; None if they name
    none."""
    causes = [text for text in words if text and not _OVER.search(text)]
    if due := [text for text in causes if text.startswith(DUE)]:
        causes = due  # the autopilot's own cause has priority over indications
    elif any(text.startswith(CAUSELESS) for text in causes):
        causes = [text for text in causes if not text.startswith("Preflight Fail")]
    for name, pattern in _NAMES:
        found = [text for text in causes if pattern.search(text)]
        if not found:
            continue
        most = max(found, key=len)
        return name if most.casefold().rstrip(".!") == name.casefold() else f"{name}: {most}"
    return None


def may_be_a_failsafe(mode_name: str) -> bool:
    """Return whether a failsafe may have caused a mode.

    >>> [may_be_a_failsafe(mode) for mode in ("RTL", "HOLD by a failsafe", "LOITER")]
    [True, True, False]
    """
    return "failsafe" in mode_name or mode_name in _BY_THEMSELVES


REPEAT_S: Final = 60.0
"""Interval after which the same text is shown again, with its count, s."""
BURST: Final = 10
"""Number of texts of each class (grave, other) that are shown at once."""
TEXT_INTERVAL_S: Final = 2.0
GRAVE_SEVERITY: Final = 3
"""Severity up to which a text is grave and does not wait behind others: MAV_SEVERITY_ERROR."""
SHOWN_SEVERITY: Final = 6
"""Severity up to which texts are shown: MAV_SEVERITY_INFO; later ones are for debugging."""
MAX_RECORDED: Final = 5000
"""Maximum number of a vehicle's texts in the journal of one run."""
MAX_REMEMBERED: Final = 200
MAX_CAUSE_AGE_S: Final = 5.0
"""Maximum time between a text and a change of mode that it explains, s."""
_SEVERITIES: Final = (
    "emergency", "alert", "critical", "error", "warning", "notice", "info", "debug",
)  # fmt: skip


@dataclass(slots=True)
class _EarlierText:
    """A text that came before."""

    shown_s: float
    times: int = 0
    """Number of times since it was shown."""


@dataclass(slots=True)
class _Allowance:
    """An allowance of texts that refills over time."""

    left: float = BURST
    at_s: float = 0.0

    def grants(self, now_s: float) -> bool:
        """Return whether one more may be shown."""
        self.left = min(self.left + max(now_s - self.at_s, 0.0) / TEXT_INTERVAL_S, float(BURST))
        self.at_s = now_s
        if self.left < 1.0:
            return False
        self.left -= 1.0
        return True


class AutopilotTexts:
    """The texts of one vehicle."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self._view = reporter.view
        self._known: dict[tuple[int, str], _EarlierText] = {}
        self._allowed = {True: _Allowance(), False: _Allowance()}
        self._unshown = 0
        self._kept = 0
        self._open_s = float("-inf")
        """Time of a change of mode that no text has explained yet, s."""
        reporter.view.on_text = self.receive

    def cause_of(self, mode_name: str) -> str | None:
        """Return the cause of a mode, by the texts up to `MAX_CAUSE_AGE_S` before; later ones may
        follow."""
        self._open_s = float("-inf")
        if not may_be_a_failsafe(mode_name):
            return None
        now_s = self._reporter.loop_s()
        cause = failsafe_of(self._view.texts_since(now_s - MAX_CAUSE_AGE_S))
        if cause is not None:
            return cause
        self._open_s = now_s
        return CAUSE_NOT_REPORTED if self._view.critical else None

    def receive(self, text: Text) -> None:
        """Handle a complete text."""
        now_s = self._reporter.loop_s()
        cause = None
        if now_s - self._open_s <= MAX_CAUSE_AGE_S:
            cause = failsafe_of([text.words])
        if cause is not None:
            self._open_s = float("-inf")
        elif not text.words or text.severity > SHOWN_SEVERITY:
            return
        known = self._known.get((text.severity, text.words))
        if known is not None:
            known.times += 1
        if cause is None and known is not None and now_s - known.shown_s < REPEAT_S:
            return
        if cause is None and not self._allowed[text.severity <= GRAVE_SEVERITY].grants(now_s):
            self._unshown += 1
            return
        times = 1 if known is None else known.times
        while len(self._known) >= MAX_REMEMBERED:
            del self._known[next(iter(self._known))]
        self._known[text.severity, text.words] = _EarlierText(now_s)
        self._show(text, times)
        if self._kept < MAX_RECORDED or cause is not None:
            self._kept += 1
            self._reporter.report_now(
                AutopilotText, text.severity, text.words, times=times, cause=cause
            )

    def _show(self, text: Text, times: int) -> None:
        number, line = self._reporter.number, self._reporter.line
        if self._unshown:
            line(f"vehicle {number}: {self._unshown} texts in quick succession are not shown")
            self._unshown = 0
        severity = _SEVERITIES[min(max(text.severity, 0), 7)]
        again = f" ({times} times)" if times > 1 else ""
        line(f"[vehicle {number}, {severity}] {text.words}{again}")
