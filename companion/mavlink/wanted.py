"""Which messages are asked of a vehicle, how often, and whether the line carries them."""

from __future__ import annotations

from collections.abc import Mapping

from companion.mavlink.dialect import Dialect

Wanted = dict[str, float]
"""Message name → Hz, the most important first."""

_IMU = {  # MAV_AUTOPILOT → IMU messages
    # PX4 has no RAW_IMU, and HIGHRES_IMU there lacks the EKF's biases: SCALED_IMU is the independent witness.
    "PX4": ("SCALED_IMU", "HIGHRES_IMU"),
    # ArduPilot's HIGHRES_IMU are floats, but perhaps of another IMU than 0: with RAW_IMU beside it that shows.
    "ARDUPILOTMEGA": ("RAW_IMU", "HIGHRES_IMU"),
}
_ANY_IMU = ("RAW_IMU", "SCALED_IMU", "HIGHRES_IMU")

_FRAME_BYTES = 12  # MAVLink 2: header and CRC
_SHARE = 0.7  # of a line's bytes that we may fill: others use it too


def wanted_from(
    autopilot: str, *, imu_hz: float = 100.0, attitude_hz: float = 50.0, position_hz: float = 20.0
) -> Wanted:
    """What to ask of an autopilot (MAV_AUTOPILOT without prefix): its IMU, attitude and position."""
    imu = dict.fromkeys(_IMU.get(autopilot, _ANY_IMU), imu_hz)
    position = {"LOCAL_POSITION_NED": position_hz, "GLOBAL_POSITION_INT": min(5.0, position_hz)}
    return imu | {"ATTITUDE": attitude_hz} | position


def load(wanted: Mapping[str, float], dialect: Dialect) -> float:
    """Bytes per second of the wanted messages, as MAVLink 2."""
    return sum(hz * (dialect.by_name[name].max_length + _FRAME_BYTES) for name, hz in wanted.items())


def fit(wanted: Mapping[str, float], dialect: Dialect, bytes_per_second: float | None) -> tuple[Wanted, str]:
    """What of it a line carries, and a sentence when that is less: all rates lowered alike.

    bytes_per_second: of the line; None when it has no limit that we know.
    """
    needed = load(wanted, dialect)
    if bytes_per_second is None or needed <= _SHARE * bytes_per_second:
        return dict(wanted), ""
    share = _SHARE * bytes_per_second / needed
    lowered = {name: max(hz * share, 1.0) for name, hz in wanted.items()}
    return lowered, (
        f"the line carries {bytes_per_second:,.0f} bytes/s and the wanted messages need {needed:,.0f}: all rates are "
        f"lowered to {share:.0%}. Use a faster baud rate."
    )
