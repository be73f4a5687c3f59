"""Maps and sets of which every version stays what it is."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator, Mapping

import pytest

from missions.mapping.persistent import PersistentMap, PersistentSet

ONE = {"b": 1, "a": 2}


def test_a_key_that_is_missing_is_an_error() -> None:
    one = PersistentMap(ONE)
    one.updated({"c": 3})
    with pytest.raises(KeyError, match="c"):
        one["c"]


def test_who_iterates_sees_one_version_while_newer_ones_are_made() -> None:
    now = PersistentMap({0: 0})
    seen = []
    for view in (now, now.keys(), now.values(), now.items()):
        for entry in view:
            seen.append(entry)
            now = now.updated({len(now): len(now)})
    assert seen == [0, 0, 0, (0, 0)]
    assert len(now) == 5


def test_what_is_handed_in_stays_the_givers() -> None:
    given = dict(ONE)
    one = PersistentMap(given)
    given["b"] = 9
    change = {"c": 3}
    two = one.updated(change)
    change["c"] = 9
    assert (dict(one), dict(two)) == (ONE, {**ONE, "c": 3})


def test_nothing_new_is_the_same_map() -> None:
    one = PersistentMap(ONE)
    assert one.updated({}) is one


def test_maps_are_equal_by_what_they_hold() -> None:
    one = PersistentMap(ONE)
    assert one == PersistentMap({"a": 2, "b": 1})
    assert one == ONE
    assert one.updated({"a": 3}) != one
    assert one.updated({"a": 3}).updated({"a": 2}) == one
    assert PersistentMap({1: one}) == PersistentMap({1: PersistentMap(ONE)})
    with pytest.raises(TypeError):
        hash(one)


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))]
)
def test_copies_hold_the_same(again: object) -> None:
    assert callable(again)
    one = PersistentMap(ONE)
    two = one.updated({"c": 3})
    assert again(one) == one
    assert again(two) == two
    assert list(again(one)) == list(one)
    assert again(PersistentSet(one)) == PersistentSet(one)


class Breaks(Mapping[str, int]):
    """A change that fails after its first key, the second time it is read."""

    def __init__(self) -> None:
        self.read = 0

    def __iter__(self) -> Iterator[str]:
        self.read += 1
        yield "a"
        if self.read > 1:
            raise RuntimeError
        yield "c"

    def __getitem__(self, key: str) -> int:
        return 7

    def __len__(self) -> int:
        return 2


def test_a_change_that_fails_half_way_changes_nothing() -> None:
    one = PersistentMap(ONE)
    with pytest.raises(RuntimeError):
        one.updated(Breaks())
    assert dict(one) == ONE


def test_a_long_history_is_freed_and_read() -> None:
    """Neither may recurse: a mission has more frames than Python has stack."""
    first = now = PersistentMap({0: 0})
    for number in range(50_000):
        now = now.updated({number % 10: number})
    assert dict(first) == {0: 0}
    early = now
    for number in range(50_000):
        now = now.updated({number % 10: -number})
    del early
    assert now[9] == -49_999


def test_a_set_stays_what_it_is() -> None:
    one = PersistentSet([2, 1])
    two = one.added([1, 3])
    assert two.added({3, 1}) is two
    less = two.without([2, 9])
    assert (set(one), set(two), set(less)) == ({1, 2}, {1, 2, 3}, {1, 3})
    assert list(two) == [2, 1, 3]


def test_a_set_does_what_a_frozenset_does() -> None:
    some, plain = PersistentSet([1, 2]), frozenset([2, 3])
    assert some | plain == plain | some == {1, 2, 3}
    assert some & plain == plain & some == {2}
    assert some - plain == {1}
    assert plain - some == {3}
    assert some ^ plain == {1, 3}
    assert PersistentSet() <= some <= some | plain
    assert some == frozenset([1, 2])
    assert frozenset([1, 2]) == some
    assert some not in (plain, frozenset())
    assert not PersistentSet()
    assert repr(some) == "PersistentSet([1, 2])"
