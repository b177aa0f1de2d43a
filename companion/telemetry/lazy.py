"""Values that are made when they are first read: of most of a flight, most never are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeVar, overload

T = TypeVar("T")


class Lazy(Mapping[str, T]):
    """Name → value, made once by the name's maker, which is forgotten with all that it held."""

    def __init__(self, makers: Mapping[str, Callable[[], T]]) -> None:
        self._names = tuple(makers)
        self._makers = dict(makers)
        self._known: dict[str, T] = {}

    def __getitem__(self, name: str) -> T:
        if name not in self._known and name in self._makers:
            self._known[name] = self._makers[name]()
            del self._makers[name]
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class LazyTuple(Sequence[T]):
    """A tuple whose items are made together, by its maker, when it is first looked into."""

    def __init__(self, maker: Callable[[], Sequence[T]]) -> None:
        self._maker: Callable[[], Sequence[T]] | None = maker
        self._known: tuple[T, ...] = ()

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[T, ...]: ...
    def __getitem__(self, index: int | slice) -> T | tuple[T, ...]:
        return self._items()[index]

    def __len__(self) -> int:
        return len(self._items())

    def _items(self) -> tuple[T, ...]:
        if self._maker is not None:
            self._known = tuple(self._maker())
            self._maker = None
        return self._known
