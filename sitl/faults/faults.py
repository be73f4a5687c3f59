"""Faults on demand: what goes wrong with a vehicle, and when.

    vehicle.fail.gps(after_s=30.0, for_s=20.0)     # in half a minute of vehicle time
    vehicle.fail.link(loss=0.2, jitter_s=0.1)      # from now on
    vehicle.fail.clear("link")                     # mended

Each method schedules one fault of the kind of its name: it begins `after_s` from now and lasts
`for_s` (None: until cleared), in the vehicle's time. Faults of one kind that overlap add up, or
the worst of them counts. The same kinds are set off by MAV_CMD_INJECT_FAILURE and by SIM_*
parameters (`sitl.faults.injection`) and by `[[sim.faults]]` of a mission file.
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
    """What happens to the frames of one direction.

    `loss`, `duplicate`, `reorder`, `corrupt` are probabilities for each frame. Frames come
    `delay_s` late, and up to `jitter_s` more, in order; a reordered one is held back until others
    have passed it. `silent`: nothing comes at all, nor what was under way.
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
        """Both at once: the larger of each.

        >>> LinkQuality(loss=0.2).worse(LinkQuality(loss=0.1, delay_s=0.5)).loss
        0.2
        """
        return LinkQuality(*map(max, astuple(self), astuple(other)))


CLEAN = LinkQuality()


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: from `begin_s` to before `end_s`, vehicle time.

    `numbers` are the kind's own: metres, m/s, volts, radians. `source` names a parameter that
    holds the fault, which replaces what it held before.
    """

    kind: Kind
    begin_s: float
    end_s: float
    numbers: tuple[float, ...] = ()
    quality: LinkQuality = CLEAN
    source: str = ""


def towards(size: float, bearing_deg: float) -> tuple[float, float]:
    """East and north of a length towards a true bearing."""
    bearing = math.radians(finite(bearing_deg))
    return size * math.sin(bearing), size * math.cos(bearing)


def finite(value: float) -> float:
    """The number, if it is one."""
    if not math.isfinite(value):
        raise ValueError(f"not a number to fly with: {value}")
    return value


def kinds_of(kind: str) -> tuple[str, ...]:
    """What a name stands for: "link" is both ways."""
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
        """What happens to frames from the clients."""
        self.down = CLEAN
        """What happens to frames to the clients."""
        self.gust_m_s = (0.0, 0.0)
        """Wind besides the world's: towards east, towards north."""
        self.camera_stalled = False
        self.picture: Literal["", "black", "corrupt"] = ""
        """What becomes of a picture taken now."""
        self.rc_lost = False
        """The radio control's signal is gone."""
        self.reboots = 0
        """How often the companion's connections have been cut."""
        # a test may set faults while another thread serves the vehicle
        self._lock = threading.RLock()
        self.scheduled: list[Fault] = []
        """The faults that are on or to come."""
        self._active: list[Fault] = []
        self._rejections: dict[int, int] = {}
        self._cells_to_fail = 0
        self._next_s = math.inf
        self._changed = False

    # --- what can go wrong -----------------------------------------------------------------------

    def gps(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Satellite navigation is lost: the estimate wanders off, or drifts with optical flow."""
        self._add("gps", after_s, for_s)

    def gps_glitch(
        self,
        metres: float,
        toward_deg: float = 90.0,
        after_s: float = 0.0,
        for_s: float | None = None,
    ) -> None:
        """Positions are wrong by `metres` towards a true bearing."""
        self._add("gps_glitch", after_s, for_s, *towards(finite(metres), toward_deg))

    def gps_drift(
        self,
        m_s: float,
        toward_deg: float = 90.0,
        after_s: float = 0.0,
        for_s: float | None = None,
    ) -> None:
        """Positions move away by `m_s` towards a true bearing (spoofing)."""
        self._add("gps_drift", after_s, for_s, *towards(finite(m_s), toward_deg))

    def battery_sag(self, volts: float, after_s: float = 0.0, for_s: float | None = None) -> None:
        """The voltage is lower by `volts`, until a swap at most; the charge stays."""
        self._add("battery_sag", after_s, for_s, finite(volts))

    def battery_cell(self, after_s: float = 0.0) -> None:
        """A cell of this pack fails: its voltage and its charge are gone until a swap."""
        self._add("battery_cell", after_s, 0.0)

    def compass(self, deg: float, after_s: float = 0.0, for_s: float | None = None) -> None:
        """The heading reads `deg` too much, clockwise, and the vehicle flies by it."""
        self._add("compass", after_s, for_s, math.radians(finite(deg)))

    def wind_gust(
        self,
        m_s: float,
        for_s: float | None = 5.0,
        from_deg: float = 0.0,
        after_s: float = 0.0,
    ) -> None:
        """More wind, `m_s` from a true bearing."""
        self._add("wind_gust", after_s, for_s, *towards(finite(m_s), from_deg + 180.0))

    def motor(self, share: float = 0.0, after_s: float = 0.0, for_s: float | None = None) -> None:
        """A motor gives only `share` of its thrust: with less than half the vehicle is lost."""
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"share is 0 to 1: {share}")
        self._add("motor", after_s, for_s, share)

    def camera_stall(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """The camera accepts commands and takes no pictures."""
        self._add("camera_stall", after_s, for_s)

    def camera_black(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """Pictures taken are black."""
        self._add("camera_black", after_s, for_s)

    def camera_corrupt(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """The files of pictures taken are broken."""
        self._add("camera_corrupt", after_s, for_s)

    def rc(self, after_s: float = 0.0, for_s: float | None = None) -> None:
        """The radio control falls silent."""
        self._add("rc", after_s, for_s)

    def reject(
        self, command: int, result: int = 4, after_s: float = 0.0, for_s: float | None = None
    ) -> None:
        """A MAV_CMD is answered with a MAV_RESULT (4: FAILED) and not carried out."""
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
        """Every client's link is bad: `LinkQuality` has what each number does.

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
        """The companion's end restarts: connections are cut, and nothing is heard for a while.

        What the vehicle has been told (rates, mission, key) it keeps.
        """
        silent = LinkQuality(silent=True)
        self._add("companion_reboot", after_s, 0.0)
        self._add("link_up", after_s, for_s, quality=silent)
        self._add("link_down", after_s, for_s, quality=silent)

    # --- mending and looking ---------------------------------------------------------------------

    def clear(self, *kinds: str) -> None:
        """End the faults of these kinds ("link" is both ways), scheduled ones too; none: all."""
        wanted = {way for kind in kinds for way in kinds_of(kind)}
        with self._lock:
            self.scheduled = [f for f in self.scheduled if wanted and f.kind not in wanted]
            self._refresh()

    def swap_battery(self) -> None:
        """What was wrong with the pack is wrong no more."""
        with self._lock:
            self.scheduled = [
                f for f in self.scheduled if f.kind != "battery_sag" or f.begin_s > self.t_s
            ]
            self._refresh()

    def hold(
        self, source: str, kind: Kind, numbers: tuple[float, ...] = (), on: bool = True
    ) -> None:
        """A fault that `source` (a parameter) sets and takes back; it replaces its last one."""
        with self._lock:
            self.scheduled = [f for f in self.scheduled if f.source != source]
            if on:
                self.scheduled.append(Fault(kind, self.t_s, math.inf, numbers, source=source))
            self._refresh()

    def held(self, source: str) -> tuple[float, ...] | None:
        """The numbers of the fault that a source holds, None when it holds none."""
        return next((f.numbers for f in self.scheduled if f.source == source), None)

    def active(self, kind: Kind) -> Iterator[Fault]:
        """The faults of a kind that are on now."""
        return (f for f in self._active if f.kind == kind)

    def rejection(self, command: int) -> int | None:
        """The result that a command is answered with whatever it asks; None: carry it out."""
        return self._rejections.get(command) if self._rejections else None

    # --- time ------------------------------------------------------------------------------------

    def step(self, t_s: float, error: PositionError, battery: Battery, body: Body) -> None:
        """The time is `t_s`: begin and end what is due, and act on the device."""
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
        """Sort out what is on now, and when that changes next."""
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
        """What follows from the active faults for links, air, camera and commands."""
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
