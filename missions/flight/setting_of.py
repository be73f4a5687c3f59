"""The layout of a mission on the ground: grid, fence, lanes, and the strategy by its name."""

from __future__ import annotations

from missions.flight.state import OneHeight, Setting
from missions.flight.strategies import chosen
from missions.flight.strategy.two_heights import TwoHeights
from missions.flight.strategy.work import Area
from missions.flight.team.teams import Alone, Listener, Member
from missions.mission.flyable import fence_of
from missions.mission.places import grid_of, homes
from missions.mission.schema import Mission, positions


def setting_of(mission: Mission, member: int | None = None) -> Setting:
    """Return the setting of a checked mission. `member` is the number of the only commanded
    vehicle, 0 for a station that only listens; None commands all."""
    grid = grid_of(mission)
    commanded = Member(member) if member else Listener()
    team = Alone() if member is None else commanded
    pads = [grid.fixed(place) for place in homes(mission)]
    fences = team.fences(mission, fence_of(mission, grid), pads)
    box = [grid.fixed(place) for place in positions(mission.search.box)]
    strategy = chosen(mission)
    lanes, east_ahead, rows = strategy.lay(Area(mission, grid, box, fences.shared, pads))
    return Setting(
        mission,
        grid,
        fences.ours,
        lanes,
        member,
        east_ahead,
        rows,
        strategy.lanes_drift,
        fences.whole,
        team=team,
        strategy=strategy,
        heights=OneHeight() if mission.search.altitude_m is None else TwoHeights(),
    )
