"""The verdict as a plain sentence."""

from __future__ import annotations

import pytest

from companion.present import headline
from companion.verdict import Cause, Finding, Verdict


@pytest.mark.parametrize(
    ("cause", "sentence"),
    [
        (Cause("accel_bias", "imu", 68.8, 80.8, 0.1, "accel", "x"), "Accelerometer x wrong, 69-81 s"),
        (Cause("gyro_bias", "imu", 68.8, None, 0.1, "gyro", imu=1), "Gyro of IMU 1 wrong, from 69 s to the end"),
        (Cause("accel_scale", "imu", 2.0, None, None, "accel"), "Accelerometer wrong, since the start"),
        (Cause("gps_position", "autopilot", 39.8, None, 0.1, "gps"), "GPS position wrong, from 40 s to the end"),
        (Cause("compass_frozen", "autopilot", 9.0, 127.6, 0.1, "compass"), "Compass frozen, 9-128 s"),
        (Cause("heading_jump", "autopilot", 39.8, 39.9), "Autopilot wrong: heading jump, at 40 s"),
        (Cause("frozen", "imu", 39.8, 50.0), "IMU wrong: frozen, 40-50 s"),
    ],
)
def test_a_cause_is_named_with_its_time(cause: Cause, sentence: str) -> None:
    assert headline(Verdict("imu_suspect", "Suspect the IMU: so it is.", (), cause)).sentence == sentence


def test_the_probability_is_said_once() -> None:
    cause = Cause("accel_bias", "imu", 68.8, 80.8, 0.1, "accel", "x", side_probability=0.9999)
    told = headline(Verdict("imu_suspect", "Suspect the IMU: bias 3 m/s² (probability over 99.9 %).", (), cause))
    assert (told.probability, told.detail) == ("probability over 99.9 %", "Bias 3 m/s².")
    agreed = "IMU and autopilot agree within the expected error (98 % of 46 windows; no sensor fault: 99.0 %)."
    told = headline(Verdict("consistent", agreed, (), None, {"nobody": 0.99, "gps": 0.01}))
    assert (told.sentence, told.probability) == ("No IMU fault found", "no fault: 99.0 %")
    assert told.detail == "IMU and autopilot agree within the expected error (98 % of 46 windows)."


def test_what_cannot_be_told_accuses_nobody() -> None:
    doubt = Finding("tilt_off", "data", "warning", 1.0, 2.0, "they differ", "", undecided=True)
    told = headline(Verdict("insufficient_data", "Cannot tell: they differ.", (doubt,)))
    assert (told.sentence, told.detail) == ("Cannot tell which side is wrong: tilt off", "They differ.")
    assert told.probability == ""
    shares = {"nobody": 0.15, "imu": 0.1, "gps": 0.0, "autopilot": 0.75}
    told = headline(Verdict("insufficient_data", "Cannot tell: they differ.", (doubt,), None, shares))
    assert told.probability == "autopilot 75 %, no fault 15 %"
    sure = headline(
        Verdict("insufficient_data", "Cannot tell: they differ.", (doubt,), None, {"nobody": 0.99, "imu": 0.01})
    )
    assert sure.probability == "", "something else than the sensors is in doubt"
    assert (
        headline(Verdict("insufficient_data", "Cannot tell: 4 Hz.", ())).sentence == "Too little in this log to judge"
    )
