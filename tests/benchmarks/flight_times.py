"""How long a mission takes by strategy, beside the survey that would be flown without one.

    python -m tests.benchmarks.flight_times                       everything, about an hour
    python -m tests.benchmarks.flight_times --mission runway --vehicles 1 --strategy rdfs

Every flight is a whole one in the simulator: take-off, search, exploration, battery swaps, way
home. The survey is the same mission in a world without a ROI: the service then sweeps the whole
box, lane by lane, at the mission's height and speed, without stopping. Two spacings: lanes three
cells apart, so that every cell is seen once (40 % side overlap here), and lanes at 75 % side
overlap, as a survey for a photomap is flown. The table gives the makespan in minutes, and in
brackets its ratio to that of the photomap survey with as many vehicles.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from uavmap.fly.flight import fly
from uavmap.fly.progress import Silent
from uavmap.mission_source import load_source
from uavmap.record.flight_plan import SIM_EPOCH_UTC_S, FlightPlan

MISSIONS = {"runway": "runway", "burn": str(Path(__file__).parents[1] / "data" / "burn.toml")}
STRATEGIES = ("rdfs", "horizon", "hungarian", "greedy")
TEAMS = (1, 3, 6)
SURVEYS = {"survey, every cell once": 4.0, "survey, 75 % overlap": 5.0 / 3.0}
"""Cell edge in metres; lanes lie three cells apart, and a picture is 20 m wide."""
BASE = "survey, 75 % overlap"


def flight(mission: str, strategy: str, vehicles: int, seed: int) -> dict[str, Any]:
    """The summary of a flight; a survey by its name in `SURVEYS`."""
    source = load_source(MISSIONS[mission])
    text, flown = source.text, strategy
    if strategy in SURVEYS:
        text = text[: text.index("[[sim.roi]]")]
        text = re.sub(r"cell_m = [0-9.]+", f"cell_m = {SURVEYS[strategy]:.9f}", text)
        flown = "rdfs"
    plan = FlightPlan(source.source, text, flown, vehicles, seed, (), None, SIM_EPOCH_UTC_S)
    with tempfile.TemporaryDirectory() as folder:
        return fly(plan, Path(folder), Silent())


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mission", action="append", choices=MISSIONS)
    parser.add_argument("--strategy", action="append")
    parser.add_argument("--vehicles", action="append", type=int)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    strategies = options.strategy or [*SURVEYS, *STRATEGIES]
    teams = options.vehicles or TEAMS
    for mission in options.mission or MISSIONS:
        print(f"\n| {mission} | " + " | ".join(f"{n} vehicle{'s' * (n > 1)}" for n in teams) + " |")
        print("|---|" + "---|" * len(teams))
        base: dict[int, float] = {}
        for strategy in sorted(strategies, key=lambda s: s != BASE):
            row = []
            for vehicles in teams:
                found = flight(mission, strategy, vehicles, options.seed)
                minutes = found["makespan_s"] / 60.0
                if strategy == BASE:
                    base[vehicles] = minutes
                ratio = f" ({minutes / base[vehicles]:.2f})" if vehicles in base else ""
                swaps = found["battery_swaps"]
                row.append(f"{minutes:.1f}{ratio}" + (f", {swaps} swaps" if swaps else ""))
                if strategy not in SURVEYS and not found["completed"]:
                    row[-1] += " incomplete"
            print(f"| {strategy} | " + " | ".join(row) + " |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
