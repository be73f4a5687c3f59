"""Recorded pictures to a map, through the same detector and votes as a flight.

    source -> tags of all pictures -> credible -> decoded and judged one by one -> votes -> map

The first pass reads tags only, and selects the pictures. The second decodes each once, at the
mission's size, on all cores. Judgements wait on disk until all pictures are read: only a comparison
shows pictures that are upside down or blurred. The weighted mean of all pictures decides a cell
(`votes.recorded`, `missions.mapping.evidence`). Or, as in a flight, the first `votes.frames` that
show it do, in the order of exposure.

A bad picture is refused with its reason, and never ends the run.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np

from missions.events import FrameLost, FrameSeen, FrameWeighed, Tracked, Vote
from missions.flight.state import Setting
from missions.mapping.evidence import Evidence
from missions.mapping.frame_sums import FrameSums
from missions.units import Cell, GridPoint
from uavmap.base.atomic_write import write_bytes
from uavmap.base.printable import printable
from uavmap.base.terminal import LINE_LIMIT
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output.drawing import judged
from uavmap.output.facts.boundary_file import BoundaryMap
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import TAKEN, Calendar, taken_meta
from uavmap.output.results import (
    Decided,
    ReplayFindings,
    Votes,
    flown_replay,
    weighed,
    write_replay,
)
from uavmap.photos.ground.fine_map import FineMap, beneath, write_ground
from uavmap.photos.ground.judging import Judge, Task
from uavmap.photos.ground.rasters import Rasters, RasterSettings
from uavmap.photos.ground.surface import Footing, Scene
from uavmap.photos.next_pictures import pictures_to_paint, write_next
from uavmap.photos.scratch_file import Spool, StoredJudgement
from uavmap.photos.sources.inventory import PICTURES_FILE, Gathered, PictureRow, write_pictures
from uavmap.photos.sources.picture_record import Placed, above_ground, credible
from uavmap.photos.workers import Crew, Threads, threads_of
from vision.camera import Camera, Lens
from vision.upright import UprightSearch

_LOG: Final = logging.getLogger("uavmap.photos")
VEHICLE: Final = 1
BLURRED: Final = 0.2
"""Minimum sharpness of a picture, as a share of the others' usual one."""
_MIN_SHARP: Final = 4  # number of pictures that give a usual sharpness
_LINES: Final = 20


@dataclass(slots=True)
class Shot:
    """A judged picture, in the order of exposure; `reason` is empty if it is used."""

    placed: Placed
    t_s: float
    reason: str = ""
    sharpness: float = 0.0
    turned: bool = False
    cells: int = 0
    camera: Camera | None = None


@dataclass(slots=True)
class JudgedPictures:
    """All pictures of a replay, judged, before any result is written.

    `refused` gives by name the reason why a picture was not decoded; `fine` is set once the results
    are written.
    """

    setting: Setting
    gathered: Gathered
    refused: Mapping[str, str]
    shots: Sequence[Shot]
    spool: Spool
    judge: Judge
    threads: Threads
    fine: FineMap | None = None

    def written(self, journal: Journal, folder: Path) -> dict[str, Any]:
        """Write journal, map and figures of the replay; return the summary."""
        scene = Scene.from_footings(self.footings(), self.setting)
        votes, evidence = self._counters()
        log = FlightLog()
        sums = FrameSums()
        journal.append_all(log.noting(self._events(votes, evidence, sums)))
        table, undecided = self._decided(votes, evidence, sums)
        mapped = ReplayFindings(
            table,
            undecided,
            [(s.t_s, s.placed.pose.position, s.placed.pose.height_m) for s in self._used],
            len(self._rows()) - len(self._used) - self.gathered.copies,
            self.gathered.copies,
        )
        calendar = Calendar.of_replay(journal.meta.get(TAKEN))
        plan = FlightPlan.read(journal)
        made = flown_replay(folder, plan, self.setting, mapped, log, calendar)

        def boundary() -> BoundaryMap | None:
            if scene is None:
                return None
            self.fine = FineMap.from_scene(
                self.setting, self.judge, scene, self.spool, self.threads
            )
            positions_m = [shot.placed.picture.position_sigma_m for shot in self._used]
            return self.fine.boundary_map(mapped.end_s, positions_m, table.cells, undecided)

        self._write_judged(folder)
        ground = None
        if scene is not None:
            grid = self.setting.grid
            ground = beneath(scene, self.spool, grid, self.threads, mapped.end_s)
            write_ground(folder, scene, self.spool, self.setting, self.threads)
        lines: list[str] = []
        summary = write_replay(made, boundary, ground, lines.append)
        for line in lines:
            _LOG.info(line)
        write_pictures(self._rows(), folder / PICTURES_FILE)
        if any(self.spool.get(n).unlike is not None for n in self.numbers[:1]):
            write_next(pictures_to_paint(self.judged(), sums, self.setting.grid.cell_m**2), folder)
        self._log()
        return summary

    def counted(self, sums: FrameSums) -> Decided:
        """Return the map's cells without a journal; fill `sums`."""
        votes, evidence = self._counters()
        for _ in self._events(votes, evidence, sums):
            pass
        return self._decided(votes, evidence, sums)

    def _counters(self) -> tuple[Votes, Evidence | None]:
        mission = self.setting.mission
        votes = Votes(mission.votes.frames, mission.votes.positive)
        return votes, Evidence() if mission.by_evidence else None

    def _decided(self, votes: Votes, evidence: Evidence | None, sums: FrameSums) -> Decided:
        section = self.setting.mission.detector
        table, undecided = votes.counted() if evidence is None else weighed(evidence, section.share)
        return table.with_sums(sums, section.explored), undecided

    def judged(self) -> Iterator[tuple[str, StoredJudgement]]:
        """Yield the name and the judgement of each used picture."""
        for number in self.numbers:
            yield self.shots[number].placed.picture.name, self.spool.get(number)

    @property
    def numbers(self) -> list[int]:
        """Numbers of the used pictures."""
        return [number for number, shot in enumerate(self.shots) if not shot.reason]

    def _write_judged(self, folder: Path) -> None:
        """Write the first picture that shows region, or else the first one, with its marks."""
        least = self.setting.mission.detector.share
        some = (n for n in self.numbers if (self.spool.get(n).shares >= least).any())
        for number in [next(some, n) for n in self.numbers[:1]]:
            image = self.judge.frame(self.shots[number].placed, self.shots[number].t_s).image
            drawn = judged.outlined(image, self.judge.detector.mask(image))
            write_bytes(folder / judged.FILE, drawn)

    def start_time(self) -> dict[str, Any]:
        """Return the time of the first picture, and its clock, for the journal's meta."""
        pictures = [shot.placed.picture for shot in self.shots]
        times = [picture.taken_s for picture in pictures if picture.taken_s is not None]
        clocks = {picture.clock for picture in pictures if picture.taken_s is not None}
        if not times or not clocks <= {"utc", "camera"}:
            return {}
        return taken_meta(min(times), "utc" if clocks == {"utc"} else "camera")

    def write_rasters(self, folder: Path, settings: RasterSettings) -> bool:
        """Write the GeoTIFFs, after all else; return True if any is. Raises `OutputError`."""
        if self.fine is None:
            return False
        placed, t_s = [shot.placed for shot in self.shots], self._used[-1].t_s
        rasters = Rasters(self.fine, self.judge, placed, t_s, self.threads)
        return rasters.write(folder, settings)

    def refuse_empty(self) -> None:
        """Raise `ImageError` if no picture is used."""
        if not self._used:
            reasons = {shot.placed.picture.name: shot.reason for shot in self.shots}
            aside = {picture.name: reason for picture, reason in self.gathered.aside}
            raise self.gathered.none_usable({**reasons, **self.refused, **aside})

    def unused(self) -> dict[str, str]:
        """Return by name the examined pictures that are not in the map, with their reasons."""
        bad = {shot.placed.picture.name: shot.reason for shot in self.shots if shot.reason}
        return {**self.refused, **bad} if self._used else {}

    def footings(self) -> list[Footing]:
        """Return the used pictures with their positions."""
        return [
            Footing(number, shot.camera, shot.placed.pose, shot.t_s, shot.turned)
            for number, shot in enumerate(self.shots)
            if not shot.reason and shot.camera is not None
        ]

    @property
    def _used(self) -> list[Shot]:
        return [shot for shot in self.shots if not shot.reason]

    def _events(
        self, votes: Votes, evidence: Evidence | None, sums: FrameSums
    ) -> Iterator[Tracked | FrameSeen | FrameWeighed | FrameLost]:
        """Yield the events of a journal; count, or weigh, their votes."""
        grid, share = self.setting.grid, self.setting.mission.detector.share
        for number, shot in enumerate(self.shots):
            point = grid.fixed(shot.placed.pose.position)
            place = GridPoint(round(point.east_m, 2), round(point.north_m, 2))
            height_m = round(shot.placed.pose.height_m, 2)
            yield Tracked(VEHICLE, shot.t_s, place, height_m, 0.0)
            if shot.reason:
                yield FrameLost(VEHICLE, shot.t_s, shot.reason)
                continue
            kept = self.spool.get(number)
            rated = kept.shares >= 0.0
            cells, positive = kept.cells[rated].astype(np.int32), kept.shares[rated] >= share
            shares = kept.shares[rated].round(3)
            columns = zip(cells.tolist(), positive.tolist(), shares.tolist(), strict=True)
            votes_seen = tuple(Vote(Cell(*cell), yes, part) for cell, yes, part in columns)
            shot.cells = len(votes_seen)
            doubtful = kept.unsure[rated]
            classes = kept.class_shares(rated)
            sums.add(cells, doubtful, classes)
            those = tuple(Cell(*cell) for cell in cells[doubtful].tolist()) or None
            yield FrameSeen(
                VEHICLE, shot.t_s, kept.vantage, votes_seen, unsure=those, classes=classes or None
            )
            if evidence is None:
                votes.add(kept.vantage, votes_seen)
                continue
            weights = kept.weights[rated].round(3)
            evidence.add_columns(cells, positive, shares, weights)
            yield FrameWeighed(VEHICLE, shot.t_s, tuple(weights.tolist()))
        for picture, reason in self.gathered.aside:
            yield FrameLost(VEHICLE, self.shots[-1].t_s, f"{printable(picture.name)}: {reason}")

    def _rows(self) -> list[PictureRow]:
        """Return a row for each picture and each unreadable file, by name."""
        shots = {shot.placed.picture.name: shot for shot in self.shots}
        rows = [PictureRow(None, name, reason, 0, False) for name, reason in self.gathered.refused]
        rows += [PictureRow(p, p.name, reason, 0, False) for p, reason in self.gathered.aside]
        for picture in self.gathered.pictures:
            name, shot = picture.name, shots.get(picture.name)
            better = self.gathered.refined.get(name)
            if shot is None:
                rows.append(PictureRow(picture, name, self.refused[name], 0, False, better))
            else:
                turned = shot.turned or name in self.gathered.upside_down
                rows.append(PictureRow(picture, name, shot.reason, shot.cells, turned, better))
        return sorted(rows, key=lambda row: row.name)

    def _log(self) -> None:
        lines = [f"{row.name}: {row.reason}; not judged" for row in self._rows() if row.reason]
        lines += [
            f"{s.placed.picture.name}: stored upside down (it overlaps its neighbours only when "
            "turned by 180 degrees); turned"
            for s in self._used
            if s.turned
        ]
        for line in lines[:_LINES]:
            _LOG.info(printable(line, LINE_LIMIT))  # a name may hold a line break
        if len(lines) > _LINES:
            _LOG.info(f"{len(lines) - _LINES} more lines like these: see pictures.csv")
        for line in self.gathered.left_out:
            _LOG.info(f"{self.gathered.source}: not read: {line}")
        fence, grid = self.setting.fence, self.setting.grid
        outside = sum(not fence.contains(grid.fixed(s.placed.pose.position)) for s in self._used)
        if outside:
            count = len(self._used)
            _LOG.info(f"{outside} of {count} photographs were taken outside of the fence")


# --- the two passes ------------------------------------------------------------------------------
def judge_pictures(
    gathered: Gathered,
    setting: Setting,
    spool: Spool,
    crew: Crew | None = None,
    *,
    lens: Lens | None = None,
    any_day: bool = False,
) -> JudgedPictures:
    """Make both passes over the pictures.

    `crew` is by default threads, one a core. `lens` is a calibration instead of tags. `any_day`
    uses pictures of other days than most. Raises `ImageError` if no picture's tags allow its use.
    """
    crew = crew or Threads()
    verdicts = credible(gathered.posed, setting.mission, any_day=any_day)
    placed = [
        replace(verdict, pose=above_ground(verdict.pose, setting))
        for verdict in verdicts
        if isinstance(verdict, Placed)
    ]
    refused = {
        picture.name: verdict
        for picture, verdict in zip(gathered.pictures, verdicts, strict=True)
        if isinstance(verdict, str)
    }
    if not placed:
        raise gathered.none_usable(refused)
    shots = _timed(placed)
    search = UprightSearch(setting.grid, UprightSearch.pitch_for([p.pose.height_m for p in placed]))
    judge = Judge.for_mission(setting.mission, setting.grid, search, lens)
    placed_all = all(entry.picture.name in gathered.refined for entry in placed)
    judge = replace(judge, compare=not placed_all)
    _judge_all(judge, shots, spool, crew)
    _refuse_blurred(shots)
    _turn(judge, shots, spool)
    # the compared features are not needed any more
    judge = replace(judge, search=UprightSearch(setting.grid, search.pitch_m))
    # pictures that were judged elsewhere are projected here
    return JudgedPictures(setting, gathered, refused, shots, spool, judge, threads_of(crew))


def _turn(judge: Judge, shots: Sequence[Shot], spool: Spool) -> None:
    """Judge again the pictures stored upside down: their masks, turned."""
    for number, (shot, turned) in enumerate(zip(shots, judge.search.turned(), strict=True)):
        if shot.reason or not turned or shot.camera is None:
            continue
        stored = spool.get(number)
        spool.put(number, judge.turned(shot.placed, shot.t_s, shot.camera, stored))
        shot.turned = True


def _timed(placed: Sequence[Placed]) -> list[Shot]:
    """Give pictures distinct times, also within a second, and those without a time."""
    shots, last_s = [], 0.0
    for number, entry in enumerate(placed, start=1):
        last_s = last_s if entry.taken_s is None else max(last_s, entry.taken_s)
        shots.append(Shot(entry, round(last_s + 1e-3 * number, 3)))
    return shots


def _judge_all(judge: Judge, shots: Sequence[Shot], spool: Spool, crew: Crew) -> None:
    """Decode and judge every picture; put each judgement on the spool."""
    seen: dict[bytes, int] = {}
    every = max(1, len(shots) // 10)
    tasks = (_task(shot, judge, crew) for shot in shots)
    answers = crew.in_order(judge.judge, tasks)
    for number, (shot, answer) in enumerate(zip(shots, answers, strict=True)):
        if isinstance(answer, str):
            shot.reason = answer
        else:
            same = seen.setdefault(answer.fingerprint, number)
            if not judge.mission.camera.noiseless:
                shot.reason = _repeats(same, number, shots)
            shot.sharpness = answer.sharpness
        if isinstance(answer, str) or shot.reason:
            judge.search.add(None)
        else:
            judge.search.add(answer.patch)
            shot.camera = answer.camera
            spool.put(number, answer.stored)
        if number % every == every - 1 or number + 1 == len(shots):
            name = printable(shot.placed.picture.name)
            _LOG.info(f"judged {number + 1} of {len(shots)}: {name}")


def _task(shot: Shot, judge: Judge, crew: Crew) -> Task:
    picture = crew.sent(shot.placed.picture, judge.mission.camera.width_px)
    return Task(replace(shot.placed, picture=picture), shot.t_s)


def _repeats(same: int, number: int, shots: Sequence[Shot]) -> str:
    if same == number:
        return ""
    if same == number - 1:
        return "the picture repeats the last one in every pixel: the camera has stalled"
    return f"the picture is {shots[same].placed.picture.name} again, in every pixel"


def _refuse_blurred(shots: Sequence[Shot]) -> None:
    """Refuse pictures less sharp than the others: the camera shook, or was out of focus."""
    known = [shot.sharpness for shot in shots if not shot.reason]
    if len(known) < _MIN_SHARP:
        return
    usual = median(known)
    for shot in shots:
        if not shot.reason and shot.sharpness < BLURRED * usual:
            share = shot.sharpness / usual
            shot.reason = f"blurred: {share:.0%} of the sharpness that the others have"
