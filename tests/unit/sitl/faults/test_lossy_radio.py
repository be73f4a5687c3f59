"""A bad radio: what is lost, late, doubled, overtaken or garbled, and that a seed repeats it."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Cutter, Packer, cut
from sitl.faults.lossy_radio import LinkQuality, Lossy

FRAMES = [bytes([n // 256, n % 256]) * 10 for n in range(2000)]


def through(quality, seed=1, frames=FRAMES):
    """Everything that arrives, with its time, of a frame each 10 ms."""
    radio = Lossy([seed])
    arrived = []
    for tick in range(len(frames) + 2000):
        now_s = tick * 0.01
        if tick < len(frames):
            radio.put([frames[tick]], quality, now_s)
        arrived += [(now_s, frame) for frame in radio.due(now_s)]
    assert radio.idle
    return arrived


def test_a_clean_radio_changes_nothing():
    arrived = through(LinkQuality())
    assert [frame for _, frame in arrived] == FRAMES
    assert [now_s for now_s, _ in arrived] == pytest.approx([n * 0.01 for n in range(2000)])


@pytest.mark.parametrize("loss", [0.05, 0.2, 1.0])
def test_loss_is_the_share_asked_for(loss):
    left = len(through(LinkQuality(loss=loss)))
    assert left == pytest.approx(2000 * (1 - loss), abs=60)


def test_late_frames_keep_their_order_and_overtaken_ones_do_not():
    late = through(LinkQuality(delay_s=0.3, jitter_s=0.1))
    assert [frame for _, frame in late] == FRAMES
    delays = [now_s - n * 0.01 for n, (now_s, _) in enumerate(late)]
    assert min(delays) >= 0.3
    assert max(delays) <= 0.41
    assert max(delays) - min(delays) > 0.08
    mixed = [frame for _, frame in through(LinkQuality(reorder=0.1))]
    assert sorted(mixed) == FRAMES
    passed = sum(a > b for a, b in pairwise(mixed))
    assert 100 < passed < 300


def test_doubled_and_garbled_frames():
    doubled = [frame for _, frame in through(LinkQuality(duplicate=0.1))]
    assert 2150 < len(doubled) < 2250
    assert sorted(set(doubled)) == FRAMES
    garbled = [frame for _, frame in through(LinkQuality(corrupt=0.1))]
    wrong = [(a, b) for a, b in zip(FRAMES, garbled, strict=True) if a != b]
    assert 150 < len(wrong) < 250
    assert all(sum(x != y for x, y in zip(a, b, strict=True)) == 1 for a, b in wrong)


def test_silence_and_what_was_under_way():
    radio = Lossy([1])
    radio.put([b"a"], LinkQuality(delay_s=1.0), 0.0)
    radio.put([b"b"], LinkQuality(silent=True), 0.0)
    radio.drop()
    assert radio.idle
    assert radio.due(2.0) == []


def test_equal_seeds_give_equal_radios():
    bad = LinkQuality(0.2, 0.1, 0.1, 0.05, 0.1, 0.1)
    assert through(bad, seed=3) == through(bad, seed=3)
    assert through(bad, seed=3) != through(bad, seed=4)


@pytest.mark.parametrize(
    "wrong", [{"loss": 1.5}, {"corrupt": -0.1}, {"delay_s": float("nan")}, {"jitter_s": -1.0}]
)
def test_impossible_qualities_are_refused(wrong):
    with pytest.raises(ValueError, match="are 0 to"):
        LinkQuality(**wrong)


@given(st.binary(max_size=600), st.integers(1, 50))
def test_cutting_loses_no_byte(data, step):
    cutter = Cutter()
    pieces = [p for at in range(0, len(data), step) for p in cutter.feed(data[at : at + step])]
    joined = b"".join(pieces)
    assert data.startswith(joined)
    assert len(data) - len(joined) < 300


def test_cutting_finds_the_frames():
    packer = Packer(1, 1)
    frames = [packer.pack(mav.MAVLink_ping_message(n, n, 0, 0)) for n in range(5)]
    assert cut(b"".join(frames)) == frames
    cutter = Cutter()
    assert cutter.feed(b"noise" + b"".join(frames)) == [b"noise", *frames]
    assert cutter.empty
