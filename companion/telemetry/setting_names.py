"""What each autopilot calls the settings that advice speaks of."""

from __future__ import annotations

from collections.abc import Mapping

from companion.model import SettingNames

_NAMES: Mapping[str, SettingNames] = {
    "ARDUPILOTMEGA": SettingNames(
        full_rate=" (LOG_BITMASK: fast or raw IMU)",
        imu_stream="SRx_RAW_SENS or SET_MESSAGE_INTERVAL",
        board_trim="AHRS_TRIM_X, _Y",
        imu_place="INS_POSn_X, _Y, _Z",
    ),
    "PX4": SettingNames(
        full_rate=" (SDLOG_PROFILE: high rate)",
        imu_stream="SCALED_IMU on an onboard link (MAV_x_MODE 2)",
        board_trim="SENS_BOARD_X_OFF, _Y_OFF",
        imu_place="EKF2_IMU_POS_X, _Y, _Z",
    ),
}


def setting_names(autopilot: str) -> SettingNames:
    """Those of an autopilot (MAV_AUTOPILOT without prefix), in general words where it is neither."""
    return _NAMES.get(autopilot, SettingNames())
