"""Members of a fleet over a bad radio, on virtual time and without flights.

Reserved air has one member, and facts reach all members.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import random
from dataclasses import dataclass, field, replace
from functools import lru_cache

from missions.events import Event
from missions.fleet_events import AirRequested, Fact, Partition
from missions.flight.airspace.airspace import SEPARATION_BUFFER_M, Airspace
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Column, Phase, VehicleState
from missions.geo.volumes import Volume
from missions.mission.checks import parse_mission
from missions.orders import FlyTo
from missions.units import Cell, GridPoint
from tests.support.fleet_rig import field_text
from tests.unit.uavmap.fleet.test_sealing import KEY, met
from uavmap.base.clock import VirtualClock, run
from uavmap.fleet.codec import AirRequest, Message, encode
from uavmap.fleet.member import Member
from uavmap.fleet.sealing import Seal
from uavmap.fleet.simulated_radio import Air, LinkModel

ROUND_S = 0.5
STEP_M = 2.0
SEEDS = 5
CLIMB_S = 12.0
"""Maximum duration of a change of layer, s."""


@lru_cache
def setting_for(member: int) -> Setting:
    return setting_of(parse_mission(field_text(high=True), "test"), member)


@dataclass(slots=True)
class WanderingMember:
    """A member with a vehicle in the air that moves at random and sometimes changes its layer."""

    number: int
    air: Air
    chance: random.Random
    ahead_s: float = 0.0
    setting: Setting = field(init=False)
    state: State = field(init=False)
    member: Member = field(init=False)
    task: asyncio.Task[None] | None = None
    holds: Column | None = None
    until_s: float = 0.0
    changes: int = 0
    serves: bool = True
    """True once its service accepts reports."""

    def __post_init__(self) -> None:
        self.setting = setting_for(self.number)
        state = self.setting.initial_state()
        place = GridPoint(4.0 + 12.0 * self.number, 40.0)
        low_m = self.setting.mission.altitude_m(self.number - 1)
        mine = replace(
            state.vehicles[self.number], phase=Phase.AIRBORNE, landed=False, position=place,
            cruise_altitude_m=low_m, height_m=low_m, home=self.setting.pad_of(self.number),
        )  # fmt: skip
        self.state = state.with_vehicle(mine)
        self.begin(1)

    def begin(self, start: int) -> None:
        """Start the program at this time, with the facts of its journal."""
        if self.task is not None:
            self.task.cancel()
            self.member.end()
        radio = self.air.radio(self.number, lambda: (self.vehicle.position, 0.0))
        seal = Seal(KEY, self.number, start)
        self.member = Member(self.setting, seal, radio, self.now_s, self.post)
        self.member.clock_moved(0.0)
        self.task = asyncio.create_task(self.member.run())

    @property
    def vehicle(self) -> VehicleState:
        return self.state.vehicles[self.number]

    def now_s(self) -> float:
        return asyncio.get_running_loop().time() + self.ahead_s

    def post(self, event: Event) -> None:
        if not self.serves:
            return
        self.state = replace(apply(self.state, event), t_s=self.now_s())
        self.member.observe(event, self.state)

    def turn(self) -> None:
        """Do one round of its work."""
        now_s, mine = self.now_s(), self.vehicle
        self.state = replace(self.state, t_s=now_s)
        if self.holds is not None:
            if now_s >= self.until_s:
                low_m = self.setting.mission.altitude_m(self.number - 1)
                layer_m = self.holds.high_m if mine.cruise_altitude_m == low_m else low_m
                mine = replace(mine, cruise_altitude_m=layer_m, height_m=layer_m, asks=None)
                self.holds, self.changes = None, self.changes + 1
        elif mine.asks is not None:
            if mine.leased_until_s >= now_s + CLIMB_S:
                self.holds = mine.asks
                self.until_s = now_s + CLIMB_S * self.chance.random()
            elif now_s > mine.asks.asked_s + 12.0:
                mine = replace(mine, asks=None)
        elif self.chance.random() < 0.1:
            high_m = self.setting.mission.search_altitude_m(self.number - 1) or 0.0
            low_m = self.setting.mission.altitude_m(self.number - 1)
            until_s = now_s + 12.0 + 2.0 * CLIMB_S
            column = Column(mine.position, low_m, high_m, now_s, until_s)
            mine = replace(mine, asks=column, leased_until_s=-math.inf)
        else:
            mine = self.wandered(mine)
        self.state = self.state.with_vehicle(mine)
        self.member.observe(AirRequested(99, now_s, mine.position, 0.0, 0.0, now_s), self.state)

    def wandered(self, mine: VehicleState) -> VehicleState:
        """Return a step to a place that the rules allow."""
        there = GridPoint(
            min(max(mine.position.east_m + self.chance.uniform(-STEP_M, STEP_M), 0.0), 44.0),
            min(max(mine.position.north_m + self.chance.uniform(-STEP_M, STEP_M), 30.0), 50.0),
        )
        order = FlyTo((there,), None, stop=True, height_m=mine.cruise_height_m)
        free = Airspace(self.state).is_clear(mine, order)
        return replace(mine, position=there) if free else mine

    @property
    def air_used(self) -> Column:
        mine = self.vehicle
        layer_m = mine.cruise_altitude_m
        return self.holds or Column(mine.position, layer_m, layer_m, 0.0, 0.0)


def too_near(one: Column, other: Column) -> bool:
    """Return whether two vehicles are nearer than allowed, with half a metre for rounded places."""
    team = setting_for(0).mission.team
    air, there = (Volume((c.place,), c.low_m, c.high_m) for c in (one, other))
    return air.meets(there, team.separation_m + SEPARATION_BUFFER_M - 0.5, team.layer_m)


async def history(seed: int) -> tuple[list[str], int, list[WanderingMember]]:
    """Run three members for some minutes; return the faults and the number of changes of layer."""
    chance = random.Random(seed)
    groups = chance.choice([(frozenset({1}), frozenset({2, 3})), (), (frozenset({1, 2}),)])
    begin_s = chance.uniform(20.0, 100.0)
    model = LinkModel(
        loss=chance.choice([0.0, 0.2]), delay_s=0.1, jitter_s=chance.choice([0.0, 4.0, 8.0]),
        doubled=0.2, partitions=(Partition(begin_s, begin_s + 60.0, groups),),
    )  # fmt: skip
    air = Air(model, seed)
    ahead = {chance.randint(1, 3): chance.choice([0.0, 30.0, 3_600.0])}
    minds = [
        WanderingMember(n, air, random.Random(10 * seed + n), ahead.get(n, 0.0)) for n in (1, 2, 3)
    ]
    dies, dies_s = chance.choice(minds), chance.uniform(30.0, 200.0)
    wrong, fact = list[str](), 0
    for k in range(480):
        await asyncio.sleep(ROUND_S)
        for mind in minds:
            mind.turn()
        if k == round(dies_s / ROUND_S):
            known = dies.member.knowledge
            dies.begin(2)
            dies.member.knowledge = known
        if k % 20 == 0 and k < 360:
            mind, fact = minds[k % 3], fact + 1
            mine = Fact(float(fact), ((Cell(fact, mind.number), True),))
            first = mind.member.knowledge.upto(mind.number)
            mind.member.knowledge.add(mind.number, first, [mine])
        for one, other in itertools.combinations(minds, 2):
            held = one.holds or other.holds
            if held and too_near(one.air_used, other.air_used):
                wrong.append(f"{one.number} and {other.number} at {k * ROUND_S:.1f} s")
    for mind in minds:
        assert mind.task is not None
        mind.task.cancel()
        mind.member.end()
    return wrong, sum(mind.changes for mind in minds), minds


def test_reserved_air_has_one_member_and_facts_reach_all():
    changes = 0
    for seed in range(SEEDS):
        wrong, changed, minds = run(history(seed), VirtualClock())
        assert not wrong, (seed, wrong)
        changes += changed
        known = [mind.member.knowledge.facts for mind in minds]
        assert known[0] == known[1] == known[2], seed
        assert sum(map(len, known[0].values())) == 18
    assert changes > 5 * SEEDS


def test_member_without_a_message_grants_no_air():
    async def asked(says: bool) -> float:
        air = Air(LinkModel())
        minds = [WanderingMember(number, air, random.Random(number)) for number in (1, 2, 3)]
        first = minds[0]
        column = Column(GridPoint(-10.0, 30.0), 12.0, 30.0, 0.0, 60.0)
        mine = replace(first.vehicle, position=column.place, asks=column)
        first.state = first.state.with_vehicle(mine)
        for mind in minds[1:]:
            mind.serves = says
        for mind in minds if says else minds[:1]:
            mind.member.observe(AirRequested(99, 0.0, column.place, 0.0, 0.0, 0.0), mind.state)
        await asyncio.sleep(20.0)
        for mind in minds:
            assert mind.task is not None
            mind.task.cancel()
        return first.vehicle.leased_until_s

    assert run(asked(True), VirtualClock()) == 60.0
    assert run(asked(False), VirtualClock()) == -math.inf


def test_message_that_was_overtaken_opens_no_air():
    async def received_asks() -> list[AirRequested]:
        ours, theirs, found = Seal(KEY, 1, 1), Seal(KEY, 2, 1), list[Event]()
        radio = Air(LinkModel()).radio(1, lambda: (GridPoint(0.0, 0.0), 0.0))
        member = Member(setting_for(1), ours, radio, lambda: 5.0, found.append)
        member.clock_moved(0.0)
        met(ours, theirs)
        ask = AirRequest(7, GridPoint(4.0, 40.0), 12.0, 30.0, 3_640.0)
        early = theirs.sealed(encode(Message(3_600.0)))
        member.receive(theirs.sealed(encode(Message(3_602.0, ask=ask))))
        member.receive(early)
        member.end()
        return [event for event in found if isinstance(event, AirRequested)]

    (only,) = run(received_asks(), VirtualClock())
    assert only.until_s == 5.0 + 38.0
