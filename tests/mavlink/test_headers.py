"""Frames one behind the other are followed; all else is left to the search, and nobody can tell which it was."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pymavlink.dialects.v20.ardupilotmega as mavlink
import pytest

from companion.mavlink import Damage, Decoder, Frames, load_dialect
from companion.mavlink.headers import CHAIN_BYTES, chain_of, crc_of
from tests.links.link import link_frames, unknown_frame

DIALECT = load_dialect()
COLUMNS = ("size", "length", "offset", "stamp", "id", "sysid", "compid", "seq", "crc")


class Searching(Decoder):
    """Looks for every frame."""

    def _chain_of(self, _chunk: object) -> Frames | None:
        return None


def heard(decoder: Decoder, data: bytes, cuts: list[int]) -> tuple[list[list[tuple[int, ...]]], list[bytes], Damage]:
    """The columns of what each push gave, the payloads, and what was lost."""
    pieces = [decoder.push(data[a:b]) for a, b in pairwise([0, *cuts, len(data)])] + [decoder.finish()]
    columns = [list(zip(*(getattr(some, name).tolist() for name in COLUMNS), strict=True)) for some in pieces]
    spans = [(some.data, *span) for some in pieces for span in zip(some.payload, some.length, strict=True)]
    return columns, [data[at : at + int(length)].tobytes() for data, at, length in spans], decoder.damage


def test_the_crc_of_one_is_that_of_pymavlink() -> None:
    rng = np.random.default_rng(1)
    for size in (0, 1, 2, 9, 60, 280):
        data = rng.integers(0, 256, size, np.uint8).tobytes()
        assert crc_of(data) == mavlink.x25crc(data).crc


@pytest.mark.parametrize("unknown", [False, True])
@pytest.mark.parametrize("harm", ["none", "flipped", "lost", "junk", "unknown ids", "a magic byte at the end"])
def test_each_push_gives_what_the_search_gives(harm: str, unknown: bool) -> None:
    rng = np.random.default_rng(2)
    frames = [*link_frames(40, seed=3), *link_frames(20, version=1), *link_frames(20, signed=True)]
    frames = [frames[i] for i in rng.permutation(len(frames))]
    for i in range(5, len(frames), 11):
        at = int(rng.integers(0, len(frames[i])))
        frames[i] = {
            "flipped": frames[i][:at] + bytes([frames[i][at] ^ 0x41]) + frames[i][at + 1 :],
            "lost": frames[i][:at],
            "junk": frames[i] + rng.integers(0, 256, 20, np.uint8).tobytes(),
            "unknown ids": unknown_frame(60_000 + i, bytes([i % 256] * 9), i % 256),
        }.get(harm, frames[i])
    data = b"".join(frames) + b"\xfd" * (harm == "a magic byte at the end")
    edges = np.cumsum([len(frame) for frame in frames])[:-1].tolist()
    for cuts in (edges, edges[::7], sorted(rng.integers(0, len(data), 80).tolist())):
        followed = Decoder(DIALECT, stamped=False, unknown=unknown)
        searched = Searching(DIALECT, stamped=False, unknown=unknown)
        assert heard(followed, data, cuts) == heard(searched, data, cuts)


def test_what_is_no_chain_is_not_followed() -> None:
    first, second = link_frames(2)
    chain = chain_of(first + second, 0, DIALECT)
    assert chain is not None
    assert chain.end.tolist() == [len(first), len(first) + len(second)]
    for cut in range(1, len(second)):
        begun = chain_of(first + second[:cut], 0, DIALECT)
        assert begun is not None
        assert begun.end.tolist() == [len(first)], "the second is not whole"
    wrong = first[:-1] + bytes([first[-1] ^ 1])
    for other in (wrong + second, first + b"\x00" + second, unknown_frame(60_000, b"abc", 1)):
        assert chain_of(other, 0, DIALECT) is None


def test_many_bytes_are_searched_as_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = b"".join(link_frames(300))
    assert len(frames) > CHAIN_BYTES
    monkeypatch.setattr("companion.mavlink.headers.chain_of", lambda *_: pytest.fail("frame by frame"))
    assert len(Decoder(DIALECT, stamped=False).push(frames)) == 300
