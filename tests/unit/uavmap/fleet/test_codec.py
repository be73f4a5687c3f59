"""Messages of members as bytes: complete, safe against damage, and short."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.classes import ClassShare
from missions.fleet_events import Fact, Part
from missions.units import Cell, GridPoint, PadHeight
from uavmap.fleet.bits import BytesError, Reader, Writer, inflated
from uavmap.fleet.codec import (
    DOES,
    ORDERS,
    PART_M,
    AirRequest,
    Batch,
    Message,
    OperatorOrder,
    Presence,
    decode,
    encode,
)
from uavmap.fleet.knowledge import MAX_RUNS, Holding

CHECKED = settings(max_examples=60, deadline=None)
halves = st.integers(-4000, 4000).map(lambda k: k / 2)
places = st.builds(GridPoint, halves, halves)
steps = st.integers(-500, 500).map(lambda k: k * PART_M)
far_places = st.builds(GridPoint, steps, steps)
numbers = st.integers(0, 100_000)
cells = st.builds(Cell, st.integers(-40, 40), st.integers(-40, 40))
decided = st.builds(
    Fact,
    numbers.map(lambda ms: ms / 1000),
    st.dictionaries(cells, st.booleans(), min_size=1, max_size=8).map(
        lambda said: tuple(sorted(said.items()))
    ),
    st.booleans(),
    seen=st.just(value=False),
    classes=st.just(()),
    doubt=st.just(value=False),
)
shown = st.builds(
    lambda ms, seen: Fact(ms / 1000, tuple((cell, False) for cell in sorted(seen)), seen=True),
    numbers,
    st.sets(cells, min_size=1, max_size=8),
)


@st.composite
def of_classes(draw: st.DrawFn) -> Fact:
    fact = draw(decided)._replace(overview=False)
    tenths = st.integers(1, 10).map(lambda k: k / 10)
    places = st.tuples(st.integers(1, 254), st.sampled_from([cell for cell, _ in fact.votes]))
    shares = draw(st.dictionaries(places, tenths, min_size=1, max_size=6))
    found = [ClassShare(cell, number, shares[number, cell]) for number, cell in sorted(shares)]
    return fact._replace(classes=tuple(found))


facts = decided | shown | of_classes()
facts |= (decided.map(lambda fact: fact._replace(overview=False)) | of_classes()).map(
    lambda fact: fact._replace(doubt=True)
)
presences = st.builds(
    Presence,
    st.sampled_from(DOES),
    places,
    halves,
    st.integers(0, 100).map(lambda percent: percent / 100),
    st.integers(0, 300).map(lambda k: k / 2),
    st.lists(numbers, max_size=5).map(tuple),
    st.lists(places, max_size=8).map(tuple),
)


def holding(upto: int, steps: list[tuple[int, int]]) -> Holding:
    beyond, end = [], upto
    for gap, length in steps:
        beyond.append((end + gap, end + gap + length))
        end += gap + length
    return Holding(upto, tuple(beyond))


counts = st.integers(1, 500)
holdings = st.builds(holding, numbers, st.lists(st.tuples(counts, counts), max_size=MAX_RUNS))
messages = st.builds(
    Message,
    numbers.map(lambda ms: ms / 1000),
    st.none() | presences,
    st.dictionaries(st.integers(0, 30), holdings, max_size=5),
    st.lists(
        st.builds(Batch, st.integers(0, 30), numbers, st.lists(facts, max_size=3).map(tuple)),
        max_size=3,
    ).map(tuple),
    st.lists(
        st.builds(OperatorOrder, numbers, st.integers(0, 9), st.sampled_from(ORDERS)), max_size=3
    ).map(tuple),
    st.booleans(),
    st.none()
    | st.builds(AirRequest, numbers, places, halves, halves, st.integers(0, 9_000).map(float)),
    st.dictionaries(st.integers(0, 30), numbers, max_size=3),
    st.lists(
        st.builds(Part, st.integers(0, 30), st.lists(far_places, max_size=9).map(tuple)), max_size=4
    ).map(tuple),
    st.none() | st.builds(PadHeight, halves, st.integers(0, 20).map(lambda k: k / 2)),
)


@CHECKED
@given(messages)
def test_message_is_decoded_as_it_was_encoded(message):
    assert decode(encode(message)) == message


@CHECKED
@given(messages, st.data())
def test_damaged_bytes_are_refused_or_another_message(message, data):
    said = bytearray(encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        said[data.draw(st.integers(0, len(said) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(said[: data.draw(st.integers(0, len(said)))])
    for damaged in (bytes(said), cut):
        with contextlib.suppress(BytesError):
            decode(damaged)


@given(st.binary(max_size=200))
def test_noise_is_refused_without_another_error(noise):
    with contextlib.suppress(BytesError):
        decode(noise)


def test_bytes_that_unpack_beyond_the_limit_are_refused():
    import zlib  # noqa: PLC0415

    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    bomb = b"\x01" + packer.compress(bytes(10_000_000)) + packer.flush()
    with pytest.raises(BytesError, match="too many"):
        inflated(bomb, 1 << 16)


def test_picture_of_too_many_cells_is_refused():
    out = Writer()
    for value in (0, 2 * 100_000, 100_000, 0, 0):
        out.count(value)
    said = Writer()
    for value in (0, 0, 0, 0, 0, 1, 0):  # time, no vehicle, nothing known, reserved; of 1 from 0
        said.count(value)
    said.raw(b"\x00" + out.data)
    with pytest.raises(BytesError, match="so many cells"):
        decode(said.data)


def test_bits_are_encoded_as_runs_or_one_by_one():
    same, mixed = [True] * 200, [k % 2 == 0 for k in range(200)]
    lengths = []
    for bits in (same, mixed):
        out = Writer()
        out.flags(bits)
        assert Reader(out.data).flags(len(bits)) == bits
        lengths.append(len(out.data))
    assert lengths[0] <= 4
    assert lengths[1] == 26


def test_minute_of_frames_fits_in_a_narrow_radio():
    """Five frames a second at 6 m/s over cells of 4 m: each column of cells in three frames."""
    told = []
    for k in range(300):
        column = int(k * 0.2 * 6 / 4)
        told.append(Fact(k / 5, tuple((Cell(column, row), row > 2) for row in range(5))))
    batches = [Batch(1, k, tuple(told[k : k + 15])) for k in range(0, 300, 15)]
    size = sum(len(encode(Message(1.0, batches=(batch,)))) for batch in batches)
    assert size < 3000
