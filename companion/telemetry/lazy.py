"""A mapping whose values are made when they are first asked for: of most of a flight, most never are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

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
