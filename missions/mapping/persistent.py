"""Immutable maps and sets whose versions share a table: a change costs as much as it changes.

A map that is copied for each change costs its whole size. Here the versions share one table, which
belongs to the newest. Each older version keeps the changes that restore it (Baker, *Shallow binding
makes functional arrays fast*, 1991). So the newest is read from a `dict`, in the order in which its
keys came. A reader of an older version pays for a copy, once. The reducer reads the newest.

An older version refers to newer ones, never the other way round. So Python deletes an unused
version. Reading an older version moves it to its own table, so versions that share one belong to
one thread at a time.
"""

from __future__ import annotations

from collections.abc import (
    Collection,
    Hashable,
    ItemsView,
    Iterable,
    Iterator,
    KeysView,
    Mapping,
    Set,
    ValuesView,
)
from typing import TypeVar, overload

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")
D = TypeVar("D")

_ABSENT = object()


class PersistentMap(Mapping[K, V]):
    """An immutable map in the order in which its keys came; no key is ever removed.

    >>> one = PersistentMap({"a": 1})
    >>> two = one.updated({"b": 2, "a": 3})
    >>> dict(one), dict(two)
    ({'a': 1}, {'a': 3, 'b': 2})
    """

    __slots__ = ("_newer", "_table", "_undo")

    def __init__(self, items: Mapping[K, V] | None = None) -> None:
        self._table: dict[K, V] | None = {} if items is None else dict(items.items())
        self._newer: PersistentMap[K, V] | None = None
        self._undo: tuple[tuple[K, V | object], ...] = ()

    def updated(self, items: Mapping[K, V]) -> PersistentMap[K, V]:
        """Return this map with other values for some keys, and with new keys."""
        if not items:
            return self
        table = self._whole()
        newer: PersistentMap[K, V] = PersistentMap.__new__(PersistentMap)
        newer._table, newer._newer, newer._undo = table, None, ()
        self._undo = tuple((key, table.get(key, _ABSENT)) for key in items)
        self._newer, self._table = newer, None
        # last, so that an interruption before leaves this version as it was
        table.update(items)
        return newer

    def as_dict(self) -> Mapping[K, V]:
        """Return the live table of this version, which costs no call in Python for each key.

        Do not keep it: the next version takes it over and changes it. An older version copies its
        table, once.
        """
        return self._whole()

    def _whole(self) -> dict[K, V]:
        """Return the table of this version, which belongs to no other."""
        if self._table is not None:
            return self._table
        older, at = [], self
        while at._table is None:
            older.append(at)
            assert at._newer is not None
            at = at._newer
        table = dict(at._table)
        for version in reversed(older):
            for key, before in version._undo:
                if before is _ABSENT:
                    table.pop(key, None)
                else:
                    table[key] = before  # type: ignore[assignment]
        self._table, self._newer, self._undo = table, None, ()
        return table

    def __getitem__(self, key: K) -> V:
        table = self._table
        return (self._whole() if table is None else table)[key]

    def __contains__(self, key: object) -> bool:
        table = self._table
        return key in (self._whole() if table is None else table)

    @overload
    def get(self, key: K, /) -> V | None: ...
    @overload
    def get(self, key: K, /, default: V | D) -> V | D: ...
    def get(self, key: K, /, default: V | D | None = None) -> V | D | None:
        """Return the value of a key, or another."""
        table = self._table
        return (self._whole() if table is None else table).get(key, default)

    def __len__(self) -> int:
        return len(self._whole())

    # Copies, at the speed of a `dict`: newer versions may be made during an iteration.
    def __iter__(self) -> Iterator[K]:
        return iter(list(self._whole()))

    def keys(self) -> KeysView[K]:
        """Return the keys, in the order in which they came."""
        return self._whole().copy().keys()

    def values(self) -> ValuesView[V]:
        """Return the values, in the order of the keys."""
        return self._whole().copy().values()

    def items(self) -> ItemsView[K, V]:
        """Return keys and values, in the order of the keys."""
        return self._whole().copy().items()

    def __eq__(self, other: object) -> bool:
        if isinstance(other, PersistentMap):
            return self is other or self._whole() == other._whole()
        return self._whole() == other

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[type[PersistentMap[K, V]], tuple[dict[K, V]]]:
        return type(self), (self._whole().copy(),)

    def __repr__(self) -> str:
        return f"PersistentMap({self._whole()!r})"


class PersistentSet(Set[K]):
    """An immutable set in which an addition costs only what it adds."""

    __slots__ = ("_members",)

    def __init__(self, members: Iterable[K] = ()) -> None:
        self._members: PersistentMap[K, None] = PersistentMap(dict.fromkeys(members))

    def added(self, members: Iterable[K]) -> PersistentSet[K]:
        """Return this set with more members."""
        new = dict.fromkeys(member for member in members if member not in self._members)
        if not new:
            return self
        grown: PersistentSet[K] = PersistentSet.__new__(PersistentSet)
        grown._members = self._members.updated(new)
        return grown

    def as_dict(self) -> Mapping[K, None]:
        """Return the members as keys of a table, to be read at once."""
        return self._members.as_dict()

    def without(self, members: Collection[K]) -> PersistentSet[K]:
        """Return this set without some members, which costs the size of the set."""
        return PersistentSet(member for member in self._members if member not in members)

    def __contains__(self, member: object) -> bool:
        return member in self._members

    def __iter__(self) -> Iterator[K]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def __repr__(self) -> str:
        return f"PersistentSet({list(self._members)!r})"
