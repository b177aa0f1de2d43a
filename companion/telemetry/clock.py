"""One clock for a flight: device time in seconds since boot, whatever the log's stamps say; and when it was zero.

`dt` never comes from the arrival of packets: stamps jitter by 5-30 ms on a cable and 0.1-2 s on a radio, run 5-30
times too fast in replays, and step backwards. Log time only orders, and ties messages that carry no device time.

Also here: time stamps that leave the flight's own course, as one flipped bit makes them: what carries one is left out,
counted. A .bin and a .ulg have no checksum, and a frame with a right one may still lie: one such time makes a flight of
thousands of years, and every grid over it larger than memory. What the autopilot itself does to its clock stays: gaps,
reboots, steps back, and packets that come late or twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.mavlink import Index, Messages
from companion.model import IMU_MESSAGES, Array, Epoch, weighted_median
from companion.telemetry.samples import BoolArray

REBOOT_FALL_S = 5.0
"""A fall of the device clock by more than this, that lasts, is a reboot. Smaller ones exist without (1.4 s, once)."""

_REBOOT_SILENCE_S = 10.0

STEP_BACK_S = 0.5
"""Smaller falls are messages of different sample times in the order in which they were sent."""

STALE_JUMP_S = 10.0
"""A forward jump of the device clock by more than this while log time stands still: what came before was stale."""

UNIX_S = 1e8
"""Larger times count from 1970: three years since boot are none."""

_WRAP_S = 2.0**32 * 1e-3  # time_boot_ms is a uint32
_SHORT_WRAP_S = 2.0**32 * 1e-6  # and so is time_usec in SERVO_OUTPUT_RAW
_WINDOW = 25  # samples on either side that have to agree on a fall, so that an echo out of order is none
_AGAIN = 3  # samples in small steps after a fall: more, and the clock goes on from there


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """Device time along one sender's packets: t at the file offset of each packet that carries time_boot_ms."""

    offset: Index  # (N,) bytes from the start of the file, increasing
    t: Array  # (N,) s since boot, wraps undone
    log_time: Array  # (N,) s UNIX

    def __getitem__(self, index: slice | BoolArray) -> Clock:
        """The clock along some of the packets."""
        return Clock(self.offset[index], self.t[index], self.log_time[index])

    def at(self, offset: Index) -> Array:
        """Device time of packets without one, from their neighbours in the file. Zeros without any clock."""
        return np.interp(offset, self.offset, self.t) if len(self.t) else np.zeros(len(offset))


def device_time(messages: Messages) -> Array | None:
    """The message's own time in seconds, (N,): time_boot_ms, else time_usec; None when it carries neither.

    None too when its fields were not read.
    """
    if messages.sender_s is None and len(messages.rows) != len(messages):
        return None
    for field, unit in (("time_boot_ms", 1e-3), ("time_usec", 1e-6)):
        if field in messages.layout.fields:
            t = np.asarray(messages[field] * unit) if messages.sender_s is None else messages.sender_s
            # PX4 leaves time_usec zero in HIL_STATE_QUATERNION and others
            return t if field == "time_boot_ms" or t[:1].any() or t.any() else None
    return None


_CLOCKS = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT",
    *(name for name, one in IMU_MESSAGES.items() if one.clock == "time_boot_ms"),
)  # fmt: skip
"""Messages whose time_boot_ms is the time of their sample, on every autopilot."""

_CLOCKS_ENOUGH = 2
_SHIFT_S = 0.5  # a constant difference of less is that between sampling and sending
_SHIFT_SAMPLES = 10_000  # tell a constant as well as a million do
_CLOCK_PACKETS = 50_000  # of each: enough to place a packet that has no time of its own


def sender_clock(sender: dict[str, Messages]) -> Clock:
    """The clock of one sender, in file order, from the commonest of the messages that carry a sample's time_boot_ms.

    Without one of those from anything with time_boot_ms, else from the time_usec of an IMU. One packet alone, which
    passes no time, is a clock only where there is no other.
    """
    timed = _timed({name: m for name, m in sender.items() if len(m) > 1}) or _timed(sender)
    pieces = [_sparse(m.offset, own, m.log_time) for m in timed if (own := device_time(m)) is not None]
    if not pieces:
        return Clock(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    offset, t, log_time = (np.concatenate(column) for column in zip(*pieces, strict=True))
    order = np.argsort(offset, kind="stable")
    if not t.all():
        order = order[t[order] > 0]  # 0 means "not known" (stamps of a link that has just begun)
    offset, t, log_time = offset[order], t[order], log_time[order]
    wraps = np.round(np.diff(t, prepend=t[:1]) / _WRAP_S)  # up as well: one late packet is of before the wrap
    return Clock(offset, t - _WRAP_S * np.cumsum(wraps) if wraps.any() else t, log_time)


def _timed(sender: Mapping[str, Messages]) -> list[Messages]:
    """The messages that a clock is made of, the first choice that there is."""
    samples = sorted((sender[n] for n in _CLOCKS if n in sender), key=len, reverse=True)[:_CLOCKS_ENOUGH]
    return (
        samples
        or [m for m in sender.values() if "time_boot_ms" in m.layout.fields]
        or [sender[name] for name in IMU_MESSAGES if name in sender]
    )


def _sparse(offset: Index, t: Array, log_time: Array) -> tuple[Index, Array, Array]:
    """Some of very many packets: every n-th, and all around the places where the time does not simply go on."""
    every = len(t) // _CLOCK_PACKETS
    if every < 2:
        return offset, t, log_time
    keep = np.zeros(len(t), np.bool_)
    keep[::every] = True
    keep[-1] = True
    step = np.diff(t)
    odd = np.flatnonzero((step < 0) | (step > STALE_JUMP_S / 2))
    around = np.clip(np.add.outer(odd, np.arange(-_WINDOW, _WINDOW + 2)), 0, len(t) - 1)
    keep[around.ravel()] = True
    return offset[keep], t[keep], log_time[keep]


def reboots(clock: Clock) -> list[int]:
    """Indices into the clock at which a new boot begins: the device time falls by REBOOT_FALL_S or more and stays."""
    t = clock.t
    starts: list[int] = []
    silent = np.diff(clock.log_time) > _REBOOT_SILENCE_S  # a short boot falls by little, but it takes its time
    for i in np.flatnonzero((np.diff(t) < -REBOOT_FALL_S) | (silent & (np.diff(t) < -STEP_BACK_S))) + 1:
        before = t[max(i - _WINDOW, starts[-1] if starts else 0) : i]
        after = t[i : i + _WINDOW]
        if np.median(after) < np.median(before) - STEP_BACK_S / 2 and after.min() > 0:
            if starts and i - starts[-1] < _WINDOW:
                continue  # the same fall, seen again in packets that arrived out of order
            starts.append(int(i))
    return starts


def stale_start(clock: Clock) -> int:
    """How many packets at the head of a boot are left over from before it: the clock jumps on, log time does not.

    Radios and routers hand out what they had buffered: 1-11 packets, then +41 to +294 s with no gap in log time. Log
    time is measured by its own speed in the rest of the boot: in a replay at 30x a true gap looks short as well.
    """
    head = clock.t[: _WINDOW + 1]
    for i in np.flatnonzero(np.diff(head) > STALE_JUMP_S)[::-1]:
        lived = clock.t[-1] - clock.t[i + 1]
        logged = clock.log_time[-1] - clock.log_time[i + 1]
        pace = lived / logged if lived > 0 and logged > 0 else 1.0
        if (clock.log_time[i + 1] - clock.log_time[i]) * pace < 0.5 * (head[i + 1] - head[i]):
            return int(i) + 1
    return 0


def steps_back(clock: Clock) -> list[int]:
    """Indices at which the clock is set back without a reboot: a fall of STEP_BACK_S to REBOOT_FALL_S that stays.

    After such a step the clock goes on in small steps from where it fell to; packets that merely come late or twice are
    followed by a jump back to the present.
    """
    t, step = clock.t, np.diff(clock.t)
    large = np.flatnonzero(np.abs(step) >= 0.5 * STEP_BACK_S)  # of the others none ends what follows a fall
    steps = []
    for k, before in enumerate(large.tolist()):
        fall = -float(step[before])
        if not STEP_BACK_S < fall <= REBOOT_FALL_S:
            continue
        end = next((at for at in map(int, large[k + 1 :]) if abs(step[at]) >= 0.5 * fall), None)
        again = t[before + 1 : None if end is None else end + 1]
        caught_up = again > t[before]
        passed = int(caught_up.argmax()) + 1 if caught_up.any() else len(again) if end is None else 0
        if passed > _AGAIN:
            steps.append(before + 1)
    return steps


def boot_seconds(messages: Messages, clock: Clock) -> tuple[Array, float]:
    """Boot time of each message (N,) in s, and the offset (s) that was taken from its own stamps to get there.

    `time_usec` is microseconds since boot on current firmware, but differs by a constant 2.5-4.5 s on some of 2014-15
    and is UNIX time on others: a constant difference of more than 0.5 s from time_boot_ms is taken out.
    """
    own = device_time(messages)
    if own is None:
        return clock.at(messages.offset), 0.0
    if "time_boot_ms" in messages.layout.fields:
        if len(clock.t) and clock.t.max() > 0.9 * _WRAP_S:  # the wraps that the clock has undone
            own = own + _WRAP_S * np.round((clock.at(messages.offset) - own) / _WRAP_S)
        return own, 0.0
    if not len(clock.t) or not len(own):
        return own, 0.0
    if messages.layout.dtype["time_usec"].itemsize == 4:
        return own + _SHORT_WRAP_S * np.round((clock.at(messages.offset) - own) / _SHORT_WRAP_S), 0.0
    shift = _shift(own, messages.offset, clock)
    return (own - shift, shift) if abs(shift) > _SHIFT_S else (own, 0.0)


def _shift(own: Array, offset: Index, clock: Clock) -> float:
    """The constant by which a message's own stamps differ from the clock, s; 0 where it is not constant.

    Each message was sent between the clock packets on either side of it in the file, which bounds the constant from
    below and from above: together, the bounds of all leave little room.
    """
    some = slice(None, None, max(1, len(own) // _SHIFT_SAMPLES))
    own, offset = own[some], offset[some]
    after = np.searchsorted(clock.offset, offset)
    inside = (after > 0) & (after < len(clock.t))
    if not inside.any():  # nothing to compare with, but UNIX time is no time since boot
        return float(own[0] - clock.t[0]) if own[0] > UNIX_S else 0.0
    own, after = own[inside], after[inside]
    low, high = own - clock.t[after], own - clock.t[after - 1]
    if max(np.abs(low).max(), np.abs(high).max()) <= _SHIFT_S:  # as of most
        return 0.0
    middle = 0.5 * (low + high)
    if np.subtract(*np.percentile(middle, [75, 25])) > 0.5:
        return 0.0
    usual = np.abs(middle - np.median(middle)) <= 0.5  # a receiver without a fix repeats the stamp of its last one
    return float(0.5 * (np.percentile(low[usual], 95) + np.percentile(high[usual], 5)))


_BELIEVABLE_S = (1e9, 2.0**32)  # 2001 to 2106: an autopilot without a fix counts from 1970 or from its build
_STEADY_S = 5.0
"""Stamps that run away from the boot clock by more than this are of a replay or of a simulation that ran faster."""

_GPS_EPOCH_S = 315_964_800.0  # 1980-01-06 00:00 UTC, as UNIX time
_WEEK_S = 604_800.0
_LEAP_SECONDS = ((1_483_228_800.0, 18), (1_435_708_800.0, 17), (1_341_100_800.0, 16), (1_230_768_000.0, 15))
"""UNIX time → GPS minus UTC from then on, s (IERS Bulletin C; none has been announced since 2017)."""


def system_epoch(system_time: Messages | None, clock: Clock) -> Epoch | None:
    """By SYSTEM_TIME, which ArduPilot and PX4 set from GPS; else by the stamps of a telemetry log."""
    if system_time is not None and len(system_time.rows) == len(system_time):
        unix, boot = (system_time[n] * s for n, s in (("time_unix_usec", 1e-6), ("time_boot_ms", 1e-3)))
        if (epoch := epoch_of(unix, boot, "SYSTEM_TIME")) is not None:
            return epoch
    stamped = np.isfinite(clock.log_time)
    ahead = clock.log_time[stamped] - clock.t[stamped]
    if not len(ahead) or float(np.subtract(*np.percentile(ahead, [95, 5]))) > _STEADY_S:
        return None
    # A packet is never stamped before it was sent, so the earliest are the most punctual; the very first may be damage
    return epoch_of(clock.log_time[stamped], clock.t[stamped], "log stamps", percentile=1)


def epoch_of(unix: Array, boot: Array, source: str, *, percentile: float = 50) -> Epoch | None:
    """From pairs (N,) of world and boot time, s; None when none of them is a believable date."""
    good = (unix > _BELIEVABLE_S[0]) & (unix < _BELIEVABLE_S[1])
    return Epoch(float(np.percentile((unix - boot)[good], percentile)), source) if good.any() else None


def gps_to_unix(week: Array, seconds: Array) -> Array:
    """GPS week and seconds of the week (N,) as UNIX time, s: UTC, so without the leap seconds since 1980."""
    unix = _GPS_EPOCH_S + week * _WEEK_S + seconds
    leap = np.zeros(len(unix))
    for since, count in reversed(_LEAP_SECONDS):
        leap[unix >= since + count] = count
    return np.asarray(unix - leap)


LONGEST_WAIT_S = 1.0
"""From a measurement to its record: a second time in a record, that of its sample, is no more than this off the first,
which is the one that is checked."""

_NEIGHBOURS = 2  # on either side; together with its own, the median of five times stays at every step that lasts
_SURE = 3 * _NEIGHBOURS + 1  # samples of a stream that say by themselves where the flight was
_PASSES = 5  # a burst of wrong times thins out from its edges
_PERIODS = 3.0


@dataclass(frozen=True, slots=True)
class Course:
    """How far a time may be off the times around it."""

    disorder_s: float  # from the median of its neighbours in the stream, and no less than three median periods
    before_s: float  # the first samples of a stream may lie before what all streams cover
    after_s: float  # and its last behind it
    away_s: float  # from the median of all streams: what is further off is of another clock


ON_BOARD = Course(disorder_s=1.0, before_s=np.inf, after_s=600.0, away_s=86400.0)
"""A logger writes what it measures, in order; first of all what was said last, perhaps when the board had just booted
(PX4: test_motor at 0 s). It has one clock, and no flight lasts a day; UNIX time is 20,000 times as far away."""

ON_LINK = Course(disorder_s=10.0, before_s=600.0, after_s=600.0, away_s=np.inf)
"""Routers deliver packets late and twice, radios hand out what they had buffered minutes before a flight."""


def off_course(streams: Mapping[str, Array], course: Course) -> dict[str, BoolArray]:
    """Which samples leave the flight's course, (N,) for each stream that has such: its times (N,) s, in file order.

    Per stream: those that stand apart from the median of five, while the stream goes on as before. The first and last
    two of a stream, where nothing follows, and all of a stream of less than seven: those that lie further from what the
    other samples of all streams cover than any silence is long. In between, no sample of a stream whose times only rise
    is ever left out, however long its gaps are.
    """
    middle = _middle([t for t in streams.values() if len(t)]) if np.isfinite(course.away_s) else 0.0
    apart = {name: _apart(t, middle, course) for name, t in streams.items()}
    covered = np.array([_core(t[~apart[name]]) for name, t in streams.items() if (~apart[name]).sum() >= _SURE])
    for name, t in streams.items():
        if len(covered):
            kept = np.flatnonzero(~apart[name])
            if len(kept) >= _SURE:
                kept = np.concatenate([kept[:_NEIGHBOURS], kept[-_NEIGHBOURS:]])
            ends = t[kept][:, None]
            near = (ends >= covered[:, 0] - course.before_s) & (ends <= covered[:, 1] + course.after_s)
            apart[name][kept[~near.any(axis=1)]] = True
    return {name: mask for name, mask in apart.items() if mask.any()}


def left_out(streams: Mapping[str, Array], apart: Mapping[str, BoolArray]) -> list[str]:
    """A note for each stream that `off_course` found such samples in."""
    return [
        f"{name}: {int(mask.sum())} of {len(mask)} left out: their time stamps leave the flight's course "
        f"(the first says {streams[name][mask][0]:.6g} s)"
        for name, mask in apart.items()
    ]


def _middle(streams: list[Array]) -> float:
    """The median of the streams' medians, each with the weight of its samples."""
    if not streams:
        return 0.0
    return weighted_median(np.array([np.median(t) for t in streams]), np.array([float(len(t)) for t in streams]))


def _core(t: Array) -> tuple[float, float]:
    """What a stream covers for certain: without its first and last two."""
    inner = t[_NEIGHBOURS:-_NEIGHBOURS]
    return float(inner.min()), float(inner.max())


def _apart(t: Array, middle: float, course: Course) -> BoolArray:
    """Which of the times (N,) are none, too far from the middle, or apart from the median of five around them."""
    apart = np.asarray(~(np.abs(t - middle) < course.away_s))
    if not apart.any() and not (t[1:] < t[:-1]).any():  # as of most streams
        return apart
    for _ in range(_PASSES):
        kept = np.flatnonzero(~apart) if apart.any() else None
        rest = t if kept is None else t[kept]
        falls = np.flatnonzero(rest[1:] < rest[:-1])
        if not len(falls):
            break
        reach = np.arange(1 - _NEIGHBOURS, _NEIGHBOURS + 1)  # from one before a fall's first sample to one behind
        index = np.unique(np.clip(falls[:, None] + reach, 0, len(rest) - 1))
        around = np.clip(index[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1), 0, len(rest) - 1)
        off = np.abs(rest[index] - np.sort(rest[around], axis=1)[:, _NEIGHBOURS])
        if not (off > course.disorder_s).any():  # as of reboots alone: the median of all steps is not needed
            break
        away = off > max(course.disorder_s, _PERIODS * float(np.median(np.abs(np.diff(rest)))))
        if not away.any():
            break
        apart[index[away] if kept is None else kept[index[away]]] = True
    return apart
