"""The law of live data: however a stream is cut, it gives the flights of the whole log."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import companion as c
from companion.links import Recorder
from companion.mavlink import Decoder, Frames, load_dialect, together
from companion.model import Flight, NavState
from companion.simulate import Faults, SimulatedVehicle, fly, write_flight
from companion.strapdown import DeadReckoner
from companion.telemetry import Stream
from tests.recordings import BUNDLED, recording

pytestmark = pytest.mark.slow

STREAMS = {"RAW_IMU": 100.0, "HIGHRES_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}
BAD = Faults(drop=0.2, duplicate=0.1, reorder=0.1, garbage=0.1, reboot=(4.0,), silence=((6.0, 7.0),))


def assert_same(found: object, wanted: object, where: str = "flight") -> None:
    """Equal in everything, arrays to the last bit."""
    if dataclasses.is_dataclass(wanted):
        assert type(found) is type(wanted), where
        for field in dataclasses.fields(wanted):
            assert_same(getattr(found, field.name), getattr(wanted, field.name), f"{where}.{field.name}")
    elif isinstance(wanted, np.ndarray):
        np.testing.assert_array_equal(found, wanted, err_msg=where)
    elif hasattr(wanted, "keys"):
        assert dict(found).keys() == dict(wanted).keys(), where  # type: ignore[call-overload]
        for key in wanted.keys():  # noqa: SIM118  (a Mapping of unknown type)
            assert_same(found[key], wanted[key], f"{where}[{key}]")  # type: ignore[index]
    elif isinstance(wanted, Sequence) and not isinstance(wanted, str):
        assert isinstance(found, Sequence), where
        for i, (one, other) in enumerate(zip(found, wanted, strict=True)):
            assert_same(one, other, f"{where}[{i}]")
    else:
        assert found == wanted, where


def pieces(data: bytes, sizes: Iterator[int]) -> Iterator[Frames]:
    """The frames of a telemetry log that comes in pieces."""

    def cut() -> Iterator[bytes]:
        at = 0
        while at < len(data):
            size = next(sizes)
            yield data[at : at + size]
            at += size

    return Decoder(load_dialect(), stamped=True).decode(cut())


def streamed(data: bytes, sizes: Iterator[int]) -> Stream:
    stream = Stream()
    for piece in pieces(data, sizes):
        stream.add(piece)
    return stream


def random_sizes(seed: int, largest: int) -> Iterator[int]:
    rng = np.random.default_rng(seed)
    while True:
        yield int(rng.integers(1, largest))


@pytest.fixture(scope="module")
def bad_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight over a bad link, with a reboot in it."""
    path = tmp_path_factory.mktemp("stream") / "bad.tlog"
    write_flight(SimulatedVehicle(fly(9.0), streams=STREAMS, faults=BAD, seed=5), path)
    return path


@pytest.fixture(scope="module")
def bad_flights(bad_log: Path) -> list[Flight]:
    return list(c.open_log(bad_log))


@settings(max_examples=9, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 1000), st.sampled_from([200, 3000, 100_000]))
def test_however_it_is_cut_a_stream_gives_the_flights_of_the_log(
    bad_log: Path, bad_flights: list[Flight], seed: int, largest: int
) -> None:
    stream = streamed(bad_log.read_bytes(), random_sizes(seed, largest))
    assert_same(stream.flights(), bad_flights)


@pytest.mark.parametrize(
    "name", ["copter-demo-100hz.tlog", "copter-mission-default-rates.tlog", "sitl/two-vehicles.tlog"]
)
def test_recorded_logs_too(name: str) -> None:
    path = recording(name) if "/" in name else BUNDLED / name
    assert_same(streamed(path.read_bytes(), random_sizes(1, 20_000)).flights(), c.open_log(path))


def test_looking_on_the_way_changes_nothing(bad_log: Path, bad_flights: list[Flight]) -> None:
    stream = Stream()
    for piece in pieces(bad_log.read_bytes(), random_sizes(2, 20_000)):
        stream.add(piece)
        stream.flights()
        stream.recent(2.0)
    assert_same(stream.flights(), bad_flights)


def test_a_window_keeps_the_end_and_bounds_what_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "long.tlog"
    write_flight(SimulatedVehicle(fly(60.0), streams=STREAMS, faults=Faults(reboot=(18.0, 36.0))), path)
    whole = c.open_log(path)
    stream = Stream(window_s=12.0)
    most = 0
    for piece in pieces(path.read_bytes(), random_sizes(3, 5000)):
        stream.add(piece)
        most = max(most, stream.messages)
    assert most < 1.25 * 12.0 * 271
    (flight,) = stream.flights()
    assert flight.boot == 3, "boots are counted from the first, also those that are forgotten"
    same_end(flight, whole[-1], 9.0)
    (now,) = stream.recent(5.0)
    assert now.boot == 3
    assert now.duration == pytest.approx(5.0, abs=0.1)
    same_end(now, whole[-1], 4.0)


def same_end(found: Flight, wanted: Flight, seconds: float) -> None:
    """The last seconds of two flights are equal."""
    assert (found.vehicle, found.boot, found.parameters) == (wanted.vehicle, wanted.boot, wanted.parameters)
    since = wanted.start + wanted.duration - seconds
    for name, track in wanted.imus.items():
        for column in ("t", "gyro", "accel"):
            np.testing.assert_array_equal(
                getattr(found.imus[name], column)[found.imus[name].t > since], getattr(track, column)[track.t > since]
            )
    for one, other in ((found.require_attitude(), wanted.require_attitude()),):
        np.testing.assert_array_equal(one.t[one.t > since], other.t[other.t > since])
        same = np.abs(np.einsum("ij,ij->i", one.q_ned_frd[one.t > since], other.q_ned_frd[other.t > since]))
        np.testing.assert_allclose(same, 1.0)
    assert found.position is not None
    assert wanted.position is not None
    np.testing.assert_allclose(
        found.position.position[found.position.t > since],
        wanted.position.position[wanted.position.t > since],
        atol=2e-3,
    )


def test_the_origin_stays_where_the_flight_began(tmp_path: Path) -> None:
    path = tmp_path / "global.tlog"
    streams = {"RAW_IMU": 50.0, "ATTITUDE": 50.0, "GLOBAL_POSITION_INT": 10.0}
    write_flight(SimulatedVehicle(fly(60.0), streams=streams), path)
    (whole,) = c.open_log(path)
    stream = Stream(window_s=10.0)
    for piece in pieces(path.read_bytes(), random_sizes(3, 5000)):
        stream.add(piece)
        if stream.messages > 100:
            stream.recent(2.0)
    (flight,) = stream.flights()
    assert flight.origin == whole.origin
    same_end(flight, whole, 8.0)


def test_a_live_reckoning_is_that_of_the_whole_log(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    write_flight(SimulatedVehicle(fly(20.0), streams=STREAMS), path)
    (whole,) = c.open_log(path)
    imu = whole.imu("RAW_IMU")
    start = NavState(float(imu.t[0]), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    expected = c.dead_reckon(imu, start)
    stream, dead_reckoner, last = Stream(window_s=8.0), DeadReckoner(start), -1.0
    for piece in pieces(path.read_bytes(), random_sizes(4, 6000)):
        stream.add(piece)
        for flight in stream.recent(3.0):
            if "RAW_IMU" in flight.imus:
                track = flight.imus["RAW_IMU"]
                new = track[int(np.searchsorted(track.t, last, side="right")) :]
                if len(new):
                    dead_reckoner.push(new)
                    last = float(new.t[-1])
    dead_reckoner.finish()
    np.testing.assert_allclose(dead_reckoner.state.position, expected.position[-1], atol=1e-9)


def test_what_was_recorded_is_what_was_live(tmp_path: Path) -> None:
    """Frames of a link, taken live and recorded: the session's numbers are those of its recording."""
    vehicle = SimulatedVehicle(fly(20.0), streams=STREAMS, faults=Faults(drop=0.1, duplicate=0.1), seed=2)
    stream, decoder = Stream(), Decoder(load_dialect(), stamped=False)
    with Recorder(tmp_path / "a.tlog") as recorder:
        for second in np.arange(0.1, 20.1, 0.1):
            frames = decoder.push(b"".join(packet for _, packet in vehicle.advance(float(second))))
            recorder.write(frames)
            stream.add(frames, 1.7e9 + second)
    (live,), (recorded,) = stream.flights(), c.open_log(tmp_path / "a.tlog")
    for name in STREAMS.keys() & live.imus.keys():
        assert_same(live.imus[name], recorded.imus[name])
    assert_same(live.attitude, recorded.attitude)
    assert_same(live.position, recorded.position)
    assert_same(c.drift(live, horizons=(1, 5)).rows, c.drift(recorded, horizons=(1, 5)).rows)


def test_receipts_taken_together_are_those_taken_one_by_one() -> None:
    """Frames of many pieces of a link as one, each with its own time of arrival."""
    vehicle = SimulatedVehicle(fly(8.0, seed=3), streams=STREAMS, faults=BAD, seed=3)
    decoder, receipts = Decoder(load_dialect(), stamped=False), []
    for end in np.arange(0.02, 8.0, 0.02):
        received = 1.7e9 + float(end) + 1.3e-7
        receipts.append((decoder.push(b"".join(packet for _, packet in vehicle.advance(end))), received))
    one_by_one = Stream(window_s=60.0)
    for frames, received in receipts:
        one_by_one.add(frames, received)
    expected = one_by_one.flights()
    for at_once in (1, 3, 1000):
        as_one = Stream(window_s=60.0)
        for first in range(0, len(receipts), at_once):
            as_one.add(together(receipts[first : first + at_once]))
        assert_same(as_one.flights(), expected, f"{at_once} at once")
        assert as_one.newest == one_by_one.newest
