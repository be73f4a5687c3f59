"""Pages of the reference that are made: events, parameters of autopilots, seeded faults.

python -m tests.reference_pages      writes them into docs/reference
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, Final

from missions import events, fleet_events
from tests.campaign import mutants
from uavmap.runner.preflight import autopilot_parameters as checked

FOLDER: Final = Path(__file__).parents[1] / "docs" / "reference"
_MADE: Final = "<!-- made by: python -m tests.reference_pages -->"


_EVENTS: Final = f"""\
# Events

{_MADE}

Each line `event` of the [journal](files.md#journaljsonl) has the `kind` of one of these events and
its keys. `t_s` is the mission time in seconds. Places are metres east and north of the start, in
the grid. A key with ? may be missing: it then has its default.

| kind | keys | meaning |
|---|---|---|
"""


def events_page() -> str:
    """Return the page with every event of the journal."""
    rows = []
    for kind, event in sorted(_events()):
        keys = ", ".join(
            f"`{field.name}`" + ("" if field.default is MISSING else "?")
            for field in fields(event)
            if field.name not in ("kind", "t_s")
        )
        rows.append(f"| `{kind}` | {keys} | {_first_sentence(event)} |\n")
    return _EVENTS + "".join(rows)


def _events() -> Iterator[tuple[str, Any]]:
    for module in (events, fleet_events):
        for value in vars(module).values():
            if inspect.isclass(value) and value.__module__ == module.__name__:
                kind = getattr(value, "__dataclass_fields__", {}).get("kind")
                if kind is not None and kind.default is not MISSING:
                    yield kind.default, value


def _first_sentence(thing: object) -> str:
    text = " ".join((inspect.getdoc(thing) or "").split())
    return text.partition(". ")[0].rstrip(".").replace("|", "\\|")


_PARAMETERS: Final = f"""\
# Parameters of autopilots

{_MADE}

## Parameters that uavmap sets

`uavmap fly` sets these before a flight and reads them back. At the end it puts the old values back
([how](../how-to/preflight.md#what-is-put-back)). With `--keep-fence` it sets none of the fence.

| | ArduPilot | PX4 |
|---|---|---|
| polygon, exclusions | `fence.polygon` wider, holes smaller | the same |
| switch | `FENCE_ENABLE` 1, `FENCE_TYPE` 5 | |
| action: return | `FENCE_ACTION` 1 | `GF_ACTION` 3 |
| circle | none, by `FENCE_TYPE` | `GF_MAX_HOR_DIST` 0 |
| ceiling | `FENCE_ALT_MAX` | `GF_MAX_VER_DIST` |
| return height, of a team or above ground | `RTL_ALT` | `RTL_RETURN_ALT` |
| rally point | the pad | the pad |
| time-out of setpoints, if outside 0.5 to 1 s | `GUID_TIMEOUT` 1 | |

## Parameters that you set

The doctor compares these with the mission. If the computer fails, only the failsafes of the
autopilot remain.

* **Battery.** Set the low-battery failsafe below the reserve of the mission, so that the service
  acts first. An ArduPilot also lands at `BATT_FS_CRT_ACT` 1, with `BATT_CRT_*`.
* **Ground station.** With `FS_GCS_ENABLE` and `SYSID_MYGCS` 245 an ArduPilot returns 5 s after the
  last heartbeat of the service. This failsafe then ignores your ground station. To a PX4 the
  service is a ground station beside others: it returns `COM_DL_LOSS_T` after the last heartbeat of
  all. With `--onboard` only your own ground station counts.
* **Return height.** Choose one at or below the layer of the vehicle if no obstacle needs more.
* **Fence.** A fence of the autopilot inside that of the mission makes it refuse targets, or return
  during a flight. `uavmap fly` sets one that fits. With `--keep-fence` it flies no such mission.
"""


def parameters_page() -> str:
    """Return the page with the parameters that are read and set on autopilots."""
    lines = [_PARAMETERS]
    for title, wishes in (
        ("ArduPilot", (*checked.ARDUPILOT_CHECKS, *checked.ARDUPILOT_CLIMB_CHECKS)),
        ("ArduPilot without satellites", checked.ARDUPILOT_FLOW_CHECKS),
        ("PX4", (*checked.PX4_CHECKS, *checked.PX4_CLIMB_CHECKS)),
        ("PX4 without satellites", checked.PX4_FLOW_CHECKS),
    ):
        lines += [f"### {title}", "", "| parameter | value | otherwise |", "|---|---|---|"]
        lines += [
            f"| `{wish.name}` | {wish.wanted} | {wish.why} |" for wish in wishes if wish.wanted
        ]
        lines.append("")
    return "\n".join(lines)


_FAULTS: Final = f"""\
# Seeded faults

{_MADE}

Do the referee and the tests see faults? `python -m tests.campaign.mutants` sows one fault after the
other into a copy of the program. Flights of the campaign look for it first, then tests. A flight is
named by its world and seed, with the promise that [the referee](referee.md) saw broken. The page on
[reliability](../reliability.md) has the numbers.

| part | fault | found by |
|---|---|---|
"""


def faults_page() -> str:
    """Return the page with what found each seeded fault."""
    results, rows = mutants.results(), []
    for fault in mutants.table()[0]:
        by = "not sown yet"
        if fault.name in results:
            how, which, what, _ = results[fault.name] or ("", "nothing", "", "")
            by = f"`{which}`: {what}" if how == "flight" else f"`{which}`, {what}"
        rows.append(f"| {fault.part} | {fault.fault} | {by} |\n")
    return _FAULTS + "".join(rows)


PAGES: Final[Mapping[str, Callable[[], str]]] = {
    "events.md": events_page,
    "seeded-faults.md": faults_page,
    "parameters.md": parameters_page,
}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), "utf-8")
