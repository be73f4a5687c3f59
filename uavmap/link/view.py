"""The latest of what a vehicle has said, in our units."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.link.autopilots import ARDUPILOT, AUTOPILOTS, Autopilot

Message = Any

_NO_AUTOPILOT: Final = (mav.MAV_AUTOPILOT_INVALID, mav.MAV_AUTOPILOT_GENERIC)
"""What gimbals, cameras and companions say in their heartbeats."""
PREARM_BIT: Final = 0x10000000
EKF_ABSOLUTE: Final = 0x10
EKF_CONSTANT: Final = 0x80
TEXT_HORIZON_S: Final = 5.0
SIMULATOR_IDENTITY: Final = (0x5541, 0x534D)
"""vendor_id and product_id of the bundled simulator: nobody stands beside its aircraft."""


@dataclass(slots=True)
class VehicleView:
    """What is known of the vehicle from its messages; None where it has not said yet."""

    system_id: int = 0
    autopilot: int | None = None
    autopilot_component: int = 0
    """Bound with `system_id` by the first heartbeat of an autopilot."""
    camera_component: int = mav.MAV_COMP_ID_CAMERA
    heard_s: float = float("-inf")
    mode: int | None = None
    armed: bool = False
    failsafe: bool = False
    """The autopilot flies by itself, whatever the mode."""
    position: LatLon | None = None
    position_s: float = float("-inf")
    height_m: float = 0.0
    home_amsl_m: float = 0.0
    """What `height_m` is above, over the sea."""
    velocity_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    boot_offset_s: float | None = None
    """Loop time minus the vehicle's own time since boot."""
    home: LatLon | None = None
    landed_state: int = 0
    prearm_ok: bool = False
    ekf_flags: int = 0
    battery_s: float = float("-inf")
    """When the battery's charge was last told, on the loop's clock."""
    battery_percent: int | None = None
    energy_consumed_j: float | None = None
    identity: tuple[int, int] | None = None
    """vendor_id and product_id."""
    texts: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=20))
    texts_heard: int = 0

    def take(self, message: Message, now_s: float) -> bool:
        """Note a message; False when it is not from our vehicle."""
        name = message.get_type()
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if name == "HEARTBEAT" and message.autopilot not in _NO_AUTOPILOT:
            if self.system_id == 0:
                self.system_id, self.autopilot_component = system, component
            if (system, component) == (self.system_id, self.autopilot_component):
                self.heard_s = now_s
        if system != self.system_id:
            return False
        handler = _HANDLERS.get(name)
        if handler is not None:
            handler(self, message, now_s, component)
        return True

    @property
    def kind(self) -> Autopilot:
        """How it is flown; `connect` refuses those that are not known."""
        return AUTOPILOTS.get(self.autopilot or 0, ARDUPILOT)

    @property
    def ready_to_arm(self) -> bool:
        """The prearm bit alone turns true before the position is usable."""
        absolute = bool(self.ekf_flags & EKF_ABSOLUTE) and not self.ekf_flags & EKF_CONSTANT
        return self.prearm_ok and absolute

    @property
    def on_ground(self) -> bool:
        """Landed and disarmed."""
        return self.landed_state == mav.MAV_LANDED_STATE_ON_GROUND and not self.armed

    @property
    def is_simulator(self) -> bool:
        """Whether this is an aircraft of the bundled simulator, over whatever link."""
        return self.identity == SIMULATOR_IDENTITY

    @property
    def ground_speed_m_s(self) -> float:
        """Horizontal speed."""
        north, east, _ = self.velocity_ned_m_s
        return float((north**2 + east**2) ** 0.5)

    @property
    def mode_name(self) -> str:
        """The mode in the autopilot's words."""
        if self.mode is None:
            return "unknown"
        name = self.kind.mode_names.get(self.mode, f"mode {self.mode}")
        return f"{name} by a failsafe" if self.failsafe else name

    def remaining_wh(self, capacity_wh: float) -> float | None:
        """What is left in the battery, the lower of what two messages say; None if unknown."""
        found = []
        if self.battery_percent is not None and self.battery_percent >= 0:
            found.append(capacity_wh * min(self.battery_percent + 1, 100) / 100.0)
        if self.energy_consumed_j is not None:
            found.append(capacity_wh - self.energy_consumed_j / 3600.0)
        return min(found) if found else None

    def recent_texts(self) -> str:
        """What the vehicle said in the last seconds, for an error message."""
        if not self.texts:
            return ""
        latest_s = self.texts[-1][0]
        texts = [text for at_s, text in self.texts if latest_s - at_s <= TEXT_HORIZON_S]
        return " (vehicle: " + "; ".join(dict.fromkeys(texts)) + ")"


def _heartbeat(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    if message.type == mav.MAV_TYPE_CAMERA:
        view.camera_component = component
    if component != view.autopilot_component or message.autopilot in _NO_AUTOPILOT:
        return
    view.autopilot = message.autopilot
    view.mode = message.custom_mode
    view.armed = bool(message.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
    critical = message.system_status == mav.MAV_STATE_CRITICAL
    view.failsafe = critical and view.kind.tells_failsafe


def _position(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    if message.lat == message.lon == 0:  # an ArduPilot says so before its first fix
        return
    view.position = LatLon(message.lat / 1e7, message.lon / 1e7)
    view.position_s = now_s
    view.height_m = message.relative_alt / 1000.0
    view.home_amsl_m = (message.alt - message.relative_alt) / 1000.0
    view.velocity_ned_m_s = (message.vx / 100.0, message.vy / 100.0, message.vz / 100.0)
    offset_s = now_s - message.time_boot_ms / 1000.0
    # the message that travelled fastest tells the offset best; a restart shifts it by seconds
    if view.boot_offset_s is None or abs(offset_s - view.boot_offset_s) > 2.0:
        view.boot_offset_s = offset_s
    view.boot_offset_s = min(view.boot_offset_s, offset_s)


def _home(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.home = LatLon(message.latitude / 1e7, message.longitude / 1e7)


def _sys_status(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.prearm_ok = bool(message.onboard_control_sensors_health & PREARM_BIT)
    view.battery_percent = message.battery_remaining
    view.battery_s = now_s


def _battery(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.battery_percent = message.battery_remaining
    view.battery_s = now_s
    view.energy_consumed_j = (
        message.energy_consumed * 100.0 if message.energy_consumed >= 0 else None
    )


def _extended(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.landed_state = message.landed_state


def _ekf(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.ekf_flags = message.flags


def _version(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.identity = (message.vendor_id, message.product_id)


def _text(view: VehicleView, message: Message, now_s: float, component: int) -> None:
    view.texts.append((now_s, str(message.text)))
    view.texts_heard += 1


_HANDLERS: Final = {
    "HEARTBEAT": _heartbeat,
    "GLOBAL_POSITION_INT": _position,
    "HOME_POSITION": _home,
    "SYS_STATUS": _sys_status,
    "BATTERY_STATUS": _battery,
    "EXTENDED_SYS_STATE": _extended,
    "EKF_STATUS_REPORT": _ekf,
    "ESTIMATOR_STATUS": _ekf,  # the flags are the same
    "AUTOPILOT_VERSION": _version,
    "STATUSTEXT": _text,
}
