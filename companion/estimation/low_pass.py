"""What the low-pass of an IMU took away of its readings, given back as far as their rate allows.

Where a vehicle shakes at some hertz, by a controller that oscillates, its sensors cone and scull: turns about two axes
add up to one about the third, however small each of them is (P. G. Savage 1998, Strapdown Inertial Navigation
Integration Algorithm Design). A low-pass makes the shaking smaller, not what it adds up to, so an integration of what
it lets through turns too little, as if the gyro were biased by some mrad/s while it is shaken.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from companion.constants import num
from companion.model import Array, ImuTrack, interpolated

BoolArray = npt.NDArray[np.bool_]


def undelayed(track: ImuTrack) -> ImuTrack:
    """The track at the times that its gyro speaks of, with what the accelerometer felt then.

    A low-pass of second order delays by √2 / (2π f).
    """
    known = _corners(track)
    if known is None:
        return track
    gyro, accel = (np.sqrt(2.0) / (2.0 * np.pi * f) if f > 0 else 0.0 for f in known)
    force = track.accel
    if gyro != accel:
        force = interpolated(track.t + accel - gyro, track.t, track.accel)
    return replace(track, t=track.t - gyro, accel=force)


def restored(track: ImuTrack, gaps: BoolArray) -> ImuTrack:
    """The readings of before the low-pass, but for its delay, which the track's times do without.

    gaps: (N-1,) whether samples are missing between two; beside one the readings stay as they are.
    """
    known = _corners(track)
    if known is None:
        return track
    gyro, accel = (_given_back(track, *one, gaps) for one in zip((track.gyro, track.accel), known, strict=True))
    return replace(track, gyro=gyro, accel=accel)


def _corners(track: ImuTrack) -> tuple[float, float] | None:
    """Of gyro and accelerometer, Hz, 0 for none. Where one of both is not known, it is as the other."""
    known = [f for f in (track.gyro_low_pass_hz, track.accel_low_pass_hz) if f is not None]
    return (known[0], known[-1]) if known else None


def _given_back(track: ImuTrack, read: Array, corner_hz: float, gaps: BoolArray) -> Array:
    """Readings (N, 3) with the amplitudes that they had before a Butterworth low-pass of second order."""
    highest = min(num.RESTORED_OF_RATE * track.rate_hz, num.RESTORED_OF_CORNER * corner_hz)
    if corner_hz <= 0 or highest < num.RESTORED_MIN_OF_CORNER * corner_hz:
        return read
    kernel = _kernel(corner_hz, highest, track.rate_hz)
    reach = len(kernel) // 2
    padded = np.pad(read, ((reach, reach), (0, 0)), mode="edge")
    out = np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])
    passed = np.concatenate([[0], np.cumsum(gaps)])
    first, last = np.clip(np.arange(len(read)) + np.array([[-reach], [reach]]), 0, len(read) - 1)
    return np.where((passed[first] == passed[last])[:, None], out, read)


def _kernel(corner_hz: float, highest_hz: float, rate_hz: float) -> Array:
    """(2 M + 1,) whose convolution undoes the low-pass up to a frequency, and leaves what is constant as it is."""
    f = np.fft.rfftfreq(2 * num.FILTER_FREQUENCIES, 1.0 / rate_hz)
    s = 1j * f / corner_hz
    undone = (1.0 + np.sqrt(2.0) * s + s**2) * np.exp(-np.sqrt(2.0) * s)  # without the delay, by which times are moved
    response = 1.0 + (undone - 1.0) / (1.0 + (f / highest_hz) ** num.RESTORED_ORDER)
    reach = min(int(np.ceil(num.FILTER_LASTS * rate_hz / corner_hz)), num.FILTER_FREQUENCIES - 1)
    kernel = np.roll(np.fft.irfft(response), reach)[: 2 * reach + 1] * np.hanning(2 * reach + 3)[1:-1]
    return np.asarray(kernel / kernel.sum())
