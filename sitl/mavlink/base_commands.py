"""MAV_CMD_* of flight that mean the same to every autopilot, and places on the wire."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from sitl.body.altimeter import Altimeter
from sitl.codec.wire import Message
from sitl.copter.aiding import Answer
from sitl.copter.aircraft import Aircraft
from sitl.copter.fence import Place, zones
from sitl.copter.mission_items import FENCE, RALLY, SPEEDS, Item

ACCEPTED: int = mav.MAV_RESULT_ACCEPTED
DENIED: int = mav.MAV_RESULT_DENIED
FAILED: int = mav.MAV_RESULT_FAILED
UNSUPPORTED: int = mav.MAV_RESULT_UNSUPPORTED


@dataclass(frozen=True, slots=True)
class Request:
    """A COMMAND_LONG or COMMAND_INT; `place` is the INT's frame, latitude and longitude (1e7)."""

    command: int
    p: tuple[float, float, float, float, float, float, float]
    place: tuple[int, int, int] | None

    def integer(self, index: int) -> int | None:
        """Parameter `index` (from 1) as an integer, None when it is no finite number."""
        value = self.p[index - 1]
        return int(value) if math.isfinite(value) and abs(value) < 2**31 else None


@dataclass(frozen=True, slots=True)
class Reply:
    """Result of a command, and what is sent behind the ACK by whom.

    `before` are results that are told before that one, by whoever looks at the command first.
    `by_autopilot`: the autopilot answers, although its camera was asked.
    """

    result: int
    messages: tuple[Message, ...] = ()
    from_camera: bool = False
    before: tuple[int, ...] = ()
    by_autopilot: bool = False
    silent: bool = False


def statustext(severity: int, text: str) -> Message:
    """STATUSTEXT of at most 50 bytes."""
    return mav.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50])


HIGHEST_M = 10_000.0
_AMSL_FRAMES = (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)
_HOME_FRAMES = (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_TERRAIN_FRAMES = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)


class BaseCommands(ABC):
    """The commands that move; `table` is looked up by the number of the command.

    It knows where the world's plane lies, and so puts positions on the wire into it. `refused` is
    the MAV_RESULT of a command that is understood and cannot be done now.
    """

    refused: int = FAILED
    nowhere: int = DENIED
    """The MAV_RESULT of EXTERNAL_POSITION_ESTIMATE for what is no place on earth."""
    unknown_rally_frames: tuple[int, ...] = ()
    """Frames of rally points that are taken, and that no return knows."""

    def __init__(self, aircraft: Aircraft, plane: LocalPlane, altimeter: Altimeter) -> None:
        self._aircraft = aircraft
        self._plane = plane
        self._altimeter = altimeter
        aircraft.route.locate = self._item_place
        self.table: dict[int, Callable[[Request], Reply]] = {
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_DO_SET_MISSION_CURRENT: self._mission_current,
            mav.MAV_CMD_DO_SET_HOME: self._set_home,
            mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE: self._external_position,
            mav.MAV_CMD_RUN_PREARM_CHECKS: lambda _: Reply(
                self.refused if aircraft.armed else ACCEPTED, self._prearm_texts()
            ),
        }

    @abstractmethod
    def set_mode(self, number: int) -> Reply:
        """A custom mode by its number, as SET_MODE asks for it."""

    @property
    def _amsl_m(self) -> float:
        """The height of the world's plane above the sea, as the autopilot has it."""
        return self._altimeter.amsl_m

    def answer(self, refusal: str | None) -> Reply:
        """ACK, then (for a refusal) the text that explains it."""
        if refusal is None:
            return Reply(ACCEPTED)
        return Reply(self.refused, (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),))

    def _prearm_texts(self) -> tuple[object, ...]:
        refusal = None if self._aircraft.armed else self._aircraft.prearm_refusal()
        return () if refusal is None else (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),)

    def target(self, frame: int, lat_e7: int, lon_e7: int, altitude_m: float) -> Place | None:
        """A global position in the world's plane (east, north, up); None when it is nowhere.

        Heights above terrain are taken from the home altitude's sea level without terrain data:
        as on the real one, the vehicle then comes down.
        """
        if not (math.isfinite(altitude_m) and abs(altitude_m) <= HIGHEST_M):
            return None
        if not (abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000):
            return None
        if frame in _AMSL_FRAMES:
            up = altitude_m - self._amsl_m
        elif frame in _HOME_FRAMES:
            up = altitude_m + self._aircraft.home[2]
        elif frame in _TERRAIN_FRAMES:
            up = altitude_m - self._amsl_m
        else:
            return None
        return (*self._flat(lat_e7, lon_e7), up)

    def _flat(self, lat_e7: int, lon_e7: int) -> tuple[float, float]:
        return self._plane.to_plane(LatLon(lat_e7 / 1e7, lon_e7 / 1e7))

    def locate(self, lat_e7: int, lon_e7: int) -> Place | None:
        """Latitude and longitude in the world's plane; None when it is nowhere."""
        return self.target(mav.MAV_FRAME_GLOBAL, lat_e7, lon_e7, 0.0)

    def _item_place(self, item: Item) -> Place | None:
        return self.target(item.frame, item.x, item.y, item.z)

    def _change_speed(self, request: Request) -> Reply:
        kind = SPEEDS.get(request.integer(1) or 0)
        speed = request.p[1]
        if kind is None or not math.isfinite(speed):
            return Reply(DENIED)
        if speed > 0.0:  # -1: no change
            self._aircraft.set_speed(kind, speed)
        return Reply(ACCEPTED)

    def _external_position(self, request: Request) -> Reply:
        """EXTERNAL_POSITION_ESTIMATE: the delay, the accuracy, the place; its height is not used.

        The time of transmission is taken for the time of arrival.
        """
        ap, (_, delay_s, sigma_m) = self._aircraft, request.p[:3]
        place = None
        if request.place is not None:
            place = self.locate(*request.place[1:])
        elif abs(request.p[4]) <= 90.0 and abs(request.p[5]) <= 180.0:
            place = self.locate(round(request.p[4] * 1e7), round(request.p[5] * 1e7))
        if place is None:
            return Reply(self.nowhere)
        if not ap.home_known:
            return Reply(self.refused)
        delay_s = delay_s if math.isfinite(delay_s) else 0.0
        answer = ap.aiding.told(
            place[0], place[1], sigma_m if math.isfinite(sigma_m) else None,
            max(0.0, min(ap.aiding.most_delay_s, delay_s)), flying=ap.airborne,
        )  # fmt: skip
        results = {Answer.TAKEN: ACCEPTED, Answer.REFUSED: self.refused}
        return Reply(results.get(answer, self.nowhere))

    # --- missions, fence, home ------------------------------------------------------------------

    def _mission_current(self, request: Request) -> Reply:
        seq = request.integer(1)
        if seq is None:
            return Reply(DENIED)
        if request.p[1] == 1.0:
            self._aircraft.route.reset()
        return Reply(
            ACCEPTED if self._aircraft.route.jump_to(seq, self._aircraft) else self.refused
        )

    def _set_home(self, request: Request) -> Reply:
        if not self._aircraft.home_known:
            return Reply(self.refused)
        if request.p[0] == 1.0:
            now = self._aircraft.estimate
            self._aircraft.set_home(now.east, now.north, now.up)
            return Reply(ACCEPTED)
        if request.place is None:
            lat, lon = request.p[4], request.p[5]
            if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
                return Reply(self.refused)
            place = (int(mav.MAV_FRAME_GLOBAL), round(lat * 1e7), round(lon * 1e7))
        else:
            place = request.place
        home = self.target(*place, request.p[6])
        if home is None or place[1:] == (0, 0):
            return Reply(self.refused)
        self._aircraft.set_home(*home)
        return Reply(ACCEPTED)

    def plans_changed(self, kind: int) -> None:
        """A mission, a fence or the rally points have come or gone."""
        ap = self._aircraft
        items = ap.plans.items[kind]
        if kind == FENCE:
            ap.fence.zones = zones(items, self._flat)
        elif kind == RALLY:
            found = [(item.frame, self._item_place(item)) for item in items]
            ap.rally = tuple(place for _, place in found if place is not None)
            ap.rally_unknown = frozenset(
                place for frame, place in found if place and frame in self.unknown_rally_frames
            )
        else:
            ap.route.plan_changed()
        ap.count_items(kind, items)
