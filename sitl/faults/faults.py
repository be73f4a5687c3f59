"""Faults of a vehicle on demand.

    vehicle.fail.gps(after_s=30.0, for_s=20.0)     # in half a minute of vehicle time
    vehicle.fail.link(loss=0.2, jitter_s=0.1)      # from now on
    vehicle.fail.clear("link")                     # ended

Each method schedules one fault of the kind of its name: it begins `after_s` from now and lasts
`for_s` (None: until cleared), in vehicle time. Faults of one kind that overlap add up, or the worst
of them counts. MAV_CMD_INJECT_FAILURE, SIM_* parameters (`sitl.faults.injection`) and
`[[sim.faults]]` of a mission file begin the same kinds.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import Literal, TypeAlias, get_args

from sitl.body.battery import Battery
from sitl.body.estimator import PositionError
from sitl.body.physics import Body

Kind: TypeAlias = Literal[
    "gps", "gps_glitch", "gps_drift", "battery_sag", "battery_voltage", "battery_cell", "compass",
    "wind_gust", "motor", "camera_stall", "camera_black", "camera_corrupt", "reject", "rc",
    "link_up", "link_down", "companion_reboot",
]  # fmt: skip
Way: TypeAlias = Literal["both", "up", "down"]


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """Quality of one direction of a link.

    `loss`, `duplicate`, `reorder`, `corrupt` are probabilities for each frame. Frames arrive in
    order, `delay_s` late and up to `jitter_s` more; a reordered one waits until others have passed
    it. `silent`: no frame arrives, nor those on the way.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    corrupt: float = 0.0
    silent: bool = False

    def __post_init__(self) -> None:
        shares = (self.loss, self.duplicate, self.reorder, self.corrupt)
        if not all(0.0 <= share <= 1.0 for share in shares):
            raise ValueError(f"loss, duplicate, reorder and corrupt are 0 to 1: {self}")
        if not (0.0 <= self.delay_s <= 3600.0 and 0.0 <= self.jitter_s <= 3600.0):
            raise ValueError(f"delay_s and jitter_s are 0 to 3600: {self}")

    def worse(self, other: LinkQuality) -> LinkQuality:
        """Return the larger of each number."""
        return LinkQuality(*map(max, astuple(self), astuple(other)))


CLEAN = LinkQuality()


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: from `begin_s` to before `end_s`, vehicle time.

    `numbers` are the kind's own: metres, m/s, volts, radians. `source` names the parameter that
    holds the fault.
    """

    kind: Kind
    begin_s: float
    end_s: float
    numbers: tuple[float, ...] = ()
    quality: LinkQuality = CLEAN
    source: str = ""


def towards(size: float, bearing_deg: float) -> tuple[float, float]:
    """Return east and north of a length towards a true bearing."""
    bearing = math.radians(finite(bearing_deg))
    return size * math.sin(bearing), size * math.cos(bearing)


def finite(value: float) -> float:
    """Return a finite number; raises `ValueError` for another."""
    if not math.isfinite(value):
        raise ValueError(f"not a number to fly with: {value}")
    return value


def kinds_of(kind: str) -> tuple[str, ...]:
    """Return the kinds of a name: "link" is both directions."""
    if kind == "link":
        return "link_up", "link_down"
    if kind not in get_args(Kind):
        raise ValueError(f"no such kind of fault: {kind}; there are {', '.join(get_args(Kind))}")
    return (kind,)


_SOON_S = 1e-6
_MAX_SCHEDULED = 1000


class Faults:
    """The faults of one vehicle; `t_s` is its time."""

    def __init__(self) -> None:
        self.t_s = 0.0
        self.up = CLEAN
        """Fault of the frames from the clients."""
        self.down = CLEAN
        """Fault of the frames to the clients."""
        self.gust_m_s = (0.0, 0.0)
        """Wind besides the world's: towards east, towards north."""
        self.camera_stalled = False
        self.picture: Literal["", "black", "corrupt"] = ""
        """Damage of a picture taken now."""
        self.rc_lost = False
        """True while the signal of the radio control is lost."""
        self.reboots = 0
        """Count of cuts of the companion's connections."""
        # a test may set faults while another thread serves the vehicle
        self._lock = threading.RLock()
        self.scheduled: list[Fault] = []
        """The active faults and those to come."""
        self._active: list[Fault] = []
        self._rejections: dict[int, int] = {}
        self._cells_to_fail = 0
        self._next_s = math.inf
        self._changed = False

    # --- what can go wrong -----------------------------------------------------------------------

    def gps(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Lose satellite navigation: the estimate wanders off, or drifts with optical flow."""
        self._add("gps", after_s, for_s)

    def gps_glitch(
        self,
        metres: float,
        toward_deg: float = 90.0,
        after_s: float = 0.0,
        for_s: float | None = None,
    ) -> None:
        """Shift positions by `metres` towards a true bearing."""
        self._add("gps_glitch", after_s, for_s, *towards(finite(metres), toward_deg))

    def gps_drift(
        self, m_s: float, toward_deg: float = 90.0, after_s: float = 0.0, for_s: float | None = None
    ) -> None:
        """Move positions away by `m_s` towards a true bearing (spoofing)."""
        self._add("gps_drift", after_s, for_s, *towards(finite(m_s), toward_deg))

    def battery_sag(self, volts: float, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Lower the voltage by `volts`, until a swap at most; the charge stays."""
        self._add("battery_sag", after_s, for_s, finite(volts))

    def battery_cell(self, after_s: float = 0.0) -> None:
        """Lose a cell of this pack, its voltage and its charge, until a swap."""
        self._add("battery_cell", after_s, 0.0)

    def compass(self, deg: float, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Turn the compass by `deg` clockwise; the vehicle flies by it."""
        self._add("compass", after_s, for_s, math.radians(finite(deg)))

    def wind_gust(
        self, m_s: float, for_s: float | None = 5.0, from_deg: float = 0.0, after_s: float = 0.0
    ) -> None:
        """Add wind, `m_s` from a true bearing."""
        self._add("wind_gust", after_s, for_s, *towards(finite(m_s), from_deg + 180.0))

    def motor(self, share: float = 0.0, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Reduce a motor to `share` of its thrust: with less than half the vehicle is lost."""
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"share is 0 to 1: {share}")
        self._add("motor", after_s, for_s, share)

    def camera_stall(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Let the camera accept commands and take no pictures."""
        self._add("camera_stall", after_s, for_s)

    def camera_black(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Take black pictures."""
        self._add("camera_black", after_s, for_s)

    def camera_corrupt(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Break the files of pictures."""
        self._add("camera_corrupt", after_s, for_s)

    def rc(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Lose the radio control."""
        self._add("rc", after_s, for_s)

    def reject(
        self, command: int, result: int = 4, after_s: float = 0.0, for_s: float | None = None
    ) -> None:
        """Answer a MAV_CMD with a MAV_RESULT (4: FAILED) instead of executing it."""
        self._add("reject", after_s, for_s, float(command), float(result))

    def link(
        self,
        loss: float = 0.0,
        duplicate: float = 0.0,
        reorder: float = 0.0,
        delay_s: float = 0.0,
        jitter_s: float = 0.0,
        corrupt: float = 0.0,
        silent: bool = False,
        way: Way = "both",
        after_s: float = 0.0,
        for_s: float | None = None,
    ) -> None:
        """Degrade every client's link by the numbers of `LinkQuality`.

        `way`: "up" is towards the vehicle, "down" towards the client.
        """
        if way not in ("both", "up", "down"):
            raise ValueError(f'way is "both", "up" or "down": {way}')
        quality = LinkQuality(loss, duplicate, reorder, delay_s, jitter_s, corrupt, silent)
        if way != "down":
            self._add("link_up", after_s, for_s, quality=quality)
        if way != "up":
            self._add("link_down", after_s, for_s, quality=quality)

    def companion_reboot(self, after_s: float = 0.0, for_s: float = 20.0) -> None:
        """Restart the companion's end: cut its connections, and silence its links for a while.

        The vehicle keeps what it has received (rates, mission, key).
        """
        silent = LinkQuality(silent=True)
        self._add("companion_reboot", after_s, 0.0)
        self._add("link_up", after_s, for_s, quality=silent)
        self._add("link_down", after_s, for_s, quality=silent)

    # --- mending and looking ---------------------------------------------------------------------

    def clear(self, *kinds: str) -> None:
        """End active and scheduled faults of these kinds, by default of all."""
        wanted = {way for kind in kinds for way in kinds_of(kind)}
        with self._lock:
            self.scheduled = [f for f in self.scheduled if wanted and f.kind not in wanted]
            self._refresh()

    def swap_battery(self) -> None:
        """End the faults of the pack."""
        with self._lock:
            self.scheduled = [
                f for f in self.scheduled if f.kind != "battery_sag" or f.begin_s > self.t_s
            ]
            self._refresh()

    def hold(
        self, source: str, kind: Kind, numbers: tuple[float, ...] = (), on: bool = True
    ) -> None:
        """Set, or end, the fault of a `source` (a parameter), which holds one at a time."""
        with self._lock:
            self.scheduled = [f for f in self.scheduled if f.source != source]
            if on:
                self.scheduled.append(Fault(kind, self.t_s, math.inf, numbers, source=source))
            self._refresh()

    def held(self, source: str) -> tuple[float, ...] | None:
        """Return the numbers of the fault that a source holds, None when it holds none."""
        return next((f.numbers for f in self.scheduled if f.source == source), None)

    def active(self, kind: Kind) -> Iterator[Fault]:
        """Return the active faults of a kind."""
        return (f for f in self._active if f.kind == kind)

    def rejection(self, command: int) -> int | None:
        """Return the result that a fault answers to a command; None: execute it."""
        return self._rejections.get(command)

    # --- time ------------------------------------------------------------------------------------

    def step(self, t_s: float, error: PositionError, battery: Battery, body: Body) -> None:
        """Begin and end the faults that are due at `t_s`, and act on the device."""
        self.t_s = t_s
        if t_s + _SOON_S < self._next_s and not self._changed:
            return
        with self._lock:
            self._refresh()
            self._changed = False
            self._act(error, battery, body)

    def _add(
        self,
        kind: Kind,
        after_s: float,
        for_s: float | None,
        *numbers: float,
        quality: LinkQuality = CLEAN,
    ) -> None:
        if not (math.isfinite(after_s) and after_s >= 0.0):
            raise ValueError(f"after_s is not negative: {after_s}")
        if for_s is not None and not for_s >= 0.0:
            raise ValueError(f"for_s is not negative: {for_s}")
        if len(self.scheduled) >= _MAX_SCHEDULED:
            raise ValueError(f"more than {_MAX_SCHEDULED} faults")
        with self._lock:
            begin_s = self.t_s + after_s
            end_s = math.inf if for_s is None else begin_s + for_s
            self.scheduled.append(Fault(kind, begin_s, end_s, numbers, quality))
            self._refresh()

    def _refresh(self) -> None:
        now_s = self.t_s + _SOON_S
        begun = [f for f in self.scheduled if f.begin_s <= now_s]
        self._cells_to_fail += sum(f.kind == "battery_cell" for f in begun)
        self.reboots += sum(f.kind == "companion_reboot" for f in begun)
        self._active = [f for f in begun if f.end_s > now_s]
        self.scheduled = [f for f in self.scheduled if max(f.begin_s, f.end_s) > now_s]
        edges = [f.begin_s if f.begin_s > now_s else f.end_s for f in self.scheduled]
        self._next_s = min(edges, default=math.inf)
        self._changed = True
        self._look()

    def _look(self) -> None:
        self.up, self.down = self._quality("link_up"), self._quality("link_down")
        self.gust_m_s = self._sum("wind_gust")
        self.camera_stalled = any(self.active("camera_stall"))
        corrupt, black = any(self.active("camera_corrupt")), any(self.active("camera_black"))
        self.picture = "corrupt" if corrupt else "black" if black else ""
        self.rc_lost = any(self.active("rc"))
        self._rejections = {int(f.numbers[0]): int(f.numbers[1]) for f in self.active("reject")}

    def _act(self, error: PositionError, battery: Battery, body: Body) -> None:
        error.disturb(
            lost=any(self.active("gps")),
            glitch_m=self._sum("gps_glitch"),
            drift_m_s=self._sum("gps_drift"),
        )
        battery.disturb(
            sag_v=sum(f.numbers[0] for f in self.active("battery_sag")),
            set_v=max((f.numbers[0] for f in self.active("battery_voltage")), default=0.0),
        )
        while self._cells_to_fail > 0:
            self._cells_to_fail -= 1
            battery.fail_cell()
        body.compass_rad = sum(f.numbers[0] for f in self.active("compass"))
        body.motor_share = min((f.numbers[0] for f in self.active("motor")), default=1.0)

    def _quality(self, kind: Kind) -> LinkQuality:
        quality = CLEAN
        for fault in self.active(kind):
            quality = quality.worse(fault.quality)
        return quality

    def _sum(self, kind: Kind) -> tuple[float, float]:
        faults = list(self.active(kind))
        return sum(f.numbers[0] for f in faults), sum(f.numbers[1] for f in faults)
