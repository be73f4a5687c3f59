"""The words and numbers of a report; a row of a table is a tuple of its cells."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from uavmap.base.printable import printable
from uavmap.load.detector_source import region_in_words
from uavmap.output.facts.figures import WEAK_RATIO
from uavmap.output.facts.flight_log import Fix, navigation_in_words
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.summary import MAX_PATCHES, box_in_words, litres_in_words, state_in_words

Facts = list[tuple[str, str]]
Row = tuple[object, ...]

_MAX_TROUBLES: Final = 200
_MAX_LETTERS: Final = 300
_PASSWORD: Final = re.compile(r"//[^/@\s]*@")
"""Pattern of a password in an address: readers of a page must not see it."""


def minutes(t_s: float) -> str:
    """Write seconds as whole minutes and seconds.

    >>> minutes(125.9), minutes(0.0)
    ('2:05', '0:00')
    """
    whole = int(t_s)
    return f"{whole // 60}:{whole % 60:02d}"


# --- what was found ------------------------------------------------------------------------------
def extent_facts(flown: FlownMission) -> Facts:
    """Return area and perimeter with their bounds."""
    found, data, boundary = flown.extent, flown.data, flown.boundary
    cells = f"{np.count_nonzero(data.cells.roi):,} cells of {data.grid.cell_m:g} m"
    facts = [
        (
            "Area by cells",
            f"{_m2(found.area_m2)} ({cells}); between {_m2(found.low_m2)} and "
            f"{_m2(found.high_m2)}: a cell counts if at least {flown.least_share:.0%} is region",
        ),
        (
            "Perimeter by cells",
            f"{found.perimeter_m:,.0f} m along the sides of cells; a smooth outline through them "
            f"has {found.shortest_m:,.0f} to {found.perimeter_m:,.0f} m",
        ),
        ("Parts, holes", f"{found.parts}, {found.holes}"),
    ]
    if boundary is not None:
        known_m = boundary.uncertainty_m
        how = "" if known_m is None else f"; half of it is known within {known_m:.2f} m"
        facts[:0] = [
            (
                "Area by pixels",
                f"{_m2(boundary.area_m2)}, between {_m2(boundary.low_m2)} (P at least 0.9) and "
                f"{_m2(boundary.high_m2)} (P at least 0.1)",
            ),
            ("Boundary by pixels", f"{boundary.length_m:,.1f} m long{how}"),
        ]
        if boundary.open_m:
            facts.append(("Open boundary", f"{boundary.open_m:,.1f} m at the end of the pictures"))
    facts.append(("Position", _position(flown)))
    facts.append(("Region is", region_in_words(flown.setting.mission.detector)))
    return facts


def class_rows(flown: FlownMission) -> Iterator[Row]:
    """Yield a row per class of the region."""
    for one in flown.data.class_areas:
        yield (
            one.number,
            one.name,
            f"{len(one.cells):,}",
            f"{one.area_m2:,.0f}",
            f"{one.low_m2:,.0f} to {one.high_m2:,.0f}",
            litres_in_words(one.volume_l),
        )


def _position(flown: FlownMission) -> str:
    shared = "an error of all pictures shifts the whole map"
    if flown.boundary is not None:
        sigma_m = flown.boundary.position_m
        return f"standard deviation of a picture's place {sigma_m:.2g} m; {shared}"
    known_m = f"{flown.setting.mission.camera.pose_error_m:g} m (camera.pose_error_m)"
    return f"the assumed error of a picture's place is {known_m}; {shared}"


def certificate(flown: FlownMission) -> tuple[Facts, Facts]:
    """Return the facts on judged ground, and those on the rest."""
    values, cells = flown.values, Counter(flown.data.cells.counts())
    region = np.count_nonzero(flown.data.cells.roi)
    lost = sum(trouble.kind == "frame" for trouble in flown.log.troubles)
    unreached = number(values, "cells_abandoned")
    judged = [
        ("Frames judged", f"{int(number(values, 'frames_judged') or 0):,}"),
        ("Cells decided", f"{region:,} region, {cells['non-roi']:,} not region"),
    ]
    judged += list(_bounds(values))
    open_cells = flown.extent.open_cells
    provisional = cells["provisional"] + cells["provisional non-roi"]
    rows = [
        ("Frames lost", lost, "frames lost, or no evidence"),
        ("Cells without a verdict", provisional, "cells that too few frames show"),
        ("Open cells", open_cells, "cells of the region beside ground without a verdict"),
        ("Cells not observed", unreached, "out of reach, or beyond the fence"),
        ("Cells that lack votes", number(values, "cells_undecided"), "observed, undecided"),
        ("Cells unsure", cells["unsure"], "unlike what the detector knows"),
        ("Cells skipped", number(values, "cells_skipped"), "by the operator"),
        ("Pictures refused", number(values, "photographs_refused"), "pictures.csv has the reasons"),
    ]
    missing = [(name, f"{int(count):,} ({why})") for name, count, why in rows if count]
    lanes_m = number(values, "unsearched_m")
    if lanes_m:
        missing.append(("Search lanes", f"{lanes_m:,.0f} m without a judged frame"))
    if flown.boundary is not None and flown.boundary.open_m:
        missing.append(("Boundary", f"{flown.boundary.open_m:,.1f} m end with the pictures"))
    return judged, missing


def _bounds(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    took_s, lower_s = number(values, "exploration_s"), number(values, "lower_bound_s")
    if took_s and lower_s and took_s / lower_s <= WEAK_RATIO:
        yield (
            "Exploration",
            f"{took_s:,.1f} s; any team needs at least {lower_s:,.1f} s for the same cells, a "
            f"ratio of {took_s / lower_s:.2f}",
        )
    bound_s = number(values, "bound_makespan_s")
    if bound_s is not None and took_s:
        kept = "kept" if took_s <= bound_s else "not kept"
        yield "Bound of the strategy", f"{bound_s:,.1f} s, {kept}"


def truth_facts(flown: FlownMission) -> Facts:
    """Compare the map with the truth, which only a simulation knows."""
    values = flown.values
    named = (
        ("iou_cells", "IoU of the map with the truth", "{:.4f}"),
        ("cells_missed", "Cells missed", "{:.0f}"),
        ("detections", "Detections", "{:.0f}"),
        ("false_positives", "of these false positives", "{:.0f}"),
        ("false_negatives", "of these false negatives", "{:.0f}"),
        ("min_separation_m", "Minimum distance of two vehicles", "{:.2f} m"),
        ("fence_breaches", "Breaches of the fence", "{:.0f}"),
        ("reserve_violations", "Violations of the reserve", "{:.0f}"),
    )
    if number(values, "iou_cells") is None:
        return []
    found = ((label, form, number(values, key)) for key, label, form in named)
    return [(label, form.format(value)) for label, form, value in found if value is not None]


def flight_facts(flown: FlownMission) -> Facts:
    """Return times, distance, sorties and battery swaps."""
    values = flown.values
    named = (
        ("flight_time_s", "Flight time of all vehicles"),
        ("makespan_s", "First lift-off to last touch-down"),
    )
    facts = [
        (label, f"{minutes(value)} min") for key, label in named if (value := number(values, key))
    ]
    distance_m = number(values, "distance_m")
    if distance_m:
        facts.append(("Distance", f"{distance_m:,.0f} m"))
    for key, label in (("sorties", "Sorties"), ("battery_swaps", "Battery swaps")):
        value = number(values, key)
        if value is not None:
            facts.append((label, f"{value:.0f}"))
    return facts


# --- the flight ----------------------------------------------------------------------------------
SORTIE_HEADS: Final = (
    "Vehicle", "Sortie", "Lift-off", "Touch-down", "Flown, min:s", "Distance, m", "Charge, Wh"
)  # fmt: skip


def sortie_rows(flown: FlownMission) -> Iterator[Row]:
    """Yield a row per sortie of a flight."""
    full = flown.setting.mission.battery.capacity_wh
    for sortie in flown.log.sorties():
        fixes = flown.log.fixes_of(sortie)
        first, last = fixes[0].remaining_wh, fixes[-1].remaining_wh
        yield (
            sortie.vehicle,
            sortie.number,
            _clock(flown, sortie.start_s),
            _clock(flown, sortie.end_s) if sortie.ended else "no landing known",
            minutes(sortie.end_s - sortie.start_s),
            f"{_distance_m(fixes):,.0f}",
            f"{first:.1f} to {last:.1f} ({first / full:.0%} to {last / full:.0%})",
        )


VEHICLE_HEADS: Final = (
    "Vehicle", "Sorties", "Lift-off", "Touch-down", "Flown, min:s", "Distance, m",
    "Fresh batteries", "Least charge",
)  # fmt: skip


def vehicle_rows(flown: FlownMission) -> Iterator[Row]:
    """Yield a row per vehicle that flew: sorties, times, distance, fresh batteries, charge."""
    full = flown.setting.mission.battery.capacity_wh
    sorties = flown.log.sorties()
    for vehicle in sorted({sortie.vehicle for sortie in sorties}):
        own = [sortie for sortie in sorties if sortie.vehicle == vehicle]
        fixes = [flown.log.fixes_of(sortie) for sortie in own]
        lowest = min(fix.remaining_wh for flight in fixes for fix in flight)
        yield (
            vehicle,
            len(own),
            _clock(flown, own[0].start_s),
            _clock(flown, own[-1].end_s) if own[-1].ended else "no landing known",
            minutes(sum(sortie.end_s - sortie.start_s for sortie in own)),
            f"{sum(map(_distance_m, fixes)):,.0f}",
            sum(number == vehicle for number, _ in flown.log.swaps),
            f"{lowest / full:.0%}",
        )


def _clock(flown: FlownMission, t_s: float) -> str:
    date = flown.calendar.date(t_s)
    return f"{minutes(t_s)} min" if date is None else f"{date:%Y-%m-%d %H:%M:%S}"


def _distance_m(fixes: Sequence[Fix]) -> float:
    places = np.array([fix.place for fix in fixes], dtype=np.float64).reshape(-1, 2)
    return float(np.hypot(*np.diff(places, axis=0).T).sum())


def trouble_rows(flown: FlownMission) -> tuple[list[Row], int]:
    """Return a row per fault, and the number of rows that are left out.

    One row stands for all frames that were lost for the same reason.
    """
    lost: dict[tuple[int, str], list[float]] = {}
    for trouble in flown.log.troubles:
        if trouble.kind == "frame":
            lost.setdefault((trouble.vehicle, trouble.text), []).append(trouble.t_s)
    found = [(t.t_s, t.vehicle, t.text) for t in flown.log.troubles if t.kind != "frame"]
    for (vehicle, reason), times in lost.items():
        frames = f"{len(times)} frames" if len(times) > 1 else "frame"
        found.append((times[0], vehicle, f"{frames} lost: {reason}"))
    found.sort()
    rows: list[Row] = [
        ("", "", what)
        if flown.recorded
        else (minutes(t_s), f"vehicle {vehicle}" if vehicle else "", what)
        for t_s, vehicle, what in found[:_MAX_TROUBLES]
    ]
    return rows, max(0, len(found) - _MAX_TROUBLES)


def notes(flown: FlownMission) -> list[str]:
    """Return the summary's notes on aircraft that are down, returned early or lost satellites."""
    values, found = flown.values, list[str]()
    down = values.get("aircraft_down")
    if isinstance(down, Sequence) and not isinstance(down, str):
        found += [printable(str(line)) for line in down]
    remarks = values.get("notes")
    if isinstance(remarks, Mapping):
        found += [printable(f"vehicle {number}: {note}") for number, note in remarks.items()]
    known = values.get("navigation")
    if isinstance(known, Mapping):
        found += [f"vehicle {n}: {navigation_in_words(one)}" for n, one in known.items()]
    return found


# --- how it was set up ---------------------------------------------------------------------------
_JUDGING: Final = ("grid.", "camera.", "detector.", "votes.", "terrain")
"""Keys of a mission that affect the judging of recorded pictures."""


def settings_of(flown: FlownMission) -> Iterator[tuple[str, str, bool]]:
    """Yield the settings of a mission; for recorded pictures, only those that affect judging."""
    for key, value, given in settings(flown.setting.mission):
        if not flown.recorded or key.startswith(_JUDGING):
            yield key, value, given


def settings(section: Any, above: str = "") -> Iterator[tuple[str, str, bool]]:
    """Yield each key of a mission, as `section.key`, its value, and whether the file has it."""
    for name in type(section).model_fields:
        value, key = getattr(section, name), f"{above}{name}"
        if hasattr(type(value), "model_fields"):
            yield from settings(value, f"{key}.")
        elif isinstance(value, tuple) and value and hasattr(type(value[0]), "model_fields"):
            for number, one in enumerate(value, start=1):
                yield from settings(one, f"{key}[{number}].")
        else:
            yield key, _shown(value), name in section.model_fields_set


def _shown(value: object) -> str:
    """Write a value as in the mission file; cut long ones, hide passwords.

    >>> _shown("rtsp://me:secret@10.0.0.5/main"), _shown((True, None))
    ('rtsp://***@10.0.0.5/main', '[true, -]')
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "-"
    if isinstance(value, tuple | list):
        return printable(f"[{', '.join(map(_shown, value))}]", _MAX_LETTERS)
    return printable(_PASSWORD.sub("//***@", str(value)), _MAX_LETTERS)


def number(values: Mapping[str, Any], key: str) -> float | None:
    """Read a figure of a summary, which may come from a file that was edited."""
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if np.isfinite(value) else None


def _m2(area_m2: float) -> str:
    return f"{area_m2:,.0f} m²"


# --- patches -------------------------------------------------------------------------------------
PATCH_HEADS: Final = (
    "Patch", "m²", "First cell decided", "at, s", "last at, s", "took, s", "at least, s", "ratio",
    "drifts, m/s", "state",
)  # fmt: skip


def patch_rows(flown: FlownMission) -> tuple[list[Row], int]:
    """Return a row per patch, one for all of several, and the number of rows that are left out.

    A replay has no rows.
    """
    if flown.recorded:
        return [], 0
    found, in_all = flown.values["patches"], flown.values["patches_in_all"]
    rows = [_patch_row(str(number), one) for number, one in enumerate(found[:MAX_PATCHES], start=1)]
    if len(found) > 1:
        rows.append(_patch_row("all", in_all))
    return rows, max(0, len(found) - MAX_PATCHES)


PIECE_HEADS: Final = ("Piece", "m²", "Middle", "Found, min:s", "Mapped, min:s", "State")


def piece_rows(flown: FlownMission) -> Iterator[Row]:
    """Yield a row per piece of the region, times from the first lift-off; none for a replay."""
    for number, one in enumerate(flown.values.get("patches", ()), start=1):
        yield (
            number,
            f"{one['area_m2']:,.0f}",
            f"{one['lat_deg']:.6f}, {one['lon_deg']:.6f}",
            minutes(one["found_s"]),
            minutes(one["decided_s"]),
            state_in_words(one),
        )


def box_line(flown: FlownMission) -> str:
    """Return the decided part of a flight's search box, and the conclusion."""
    box = flown.values["patches_in_all"]["box"]
    proof = "no patch that begins in it is missing, if the verdicts are right"
    return f"{box_in_words(box)}: {proof if box['whole'] else 'a patch may be missing there'}"


def _patch_row(name: str, one: Mapping[str, Any]) -> Row:
    root = one.get("root")
    return (
        name,
        f"{one['area_m2']:,.0f}",
        "" if root is None else f"{root['lat_deg']:.6f}, {root['lon_deg']:.6f}",
        f"{one['found_s']:,.1f}",
        f"{one['decided_s']:,.1f}",
        f"{one['took_s']:,.1f}",
        f"{one['lower_bound_s']:,.1f}",
        "" if one["ratio"] is None else f"{one['ratio']:.2f}",
        _drift(one.get("drift")),
        state_in_words(one),
    )


def _drift(drift: Mapping[str, Any] | None) -> str:
    if drift is None:
        return ""
    text = f"{drift['speed_m_s']:.2f} toward {drift['toward_deg']:.0f}°"
    text += f" ± {drift['error_m_s']:.2f}"
    return f"{text}, unlike that of the mission" if drift["differs"] else text
