"""The IMU library: every part loads, in SI, within the bounds of its class, and names its sources."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.errors import InputError, SettingsError
from companion.sensors import imu_names, load_imu
from companion.settings import data_folder

WANTED = {
    "adis16470", "bmi088", "bmi270", "generic-mems", "icm-20602", "icm-20689", "icm-20948", "icm-42688-p", "icm-45686",
    "mpu-6000", "mpu-9250",
}  # fmt: skip


def test_the_library_holds_the_parts_of_common_autopilots() -> None:
    assert set(imu_names()) >= WANTED


@pytest.mark.parametrize("name", sorted(WANTED))
def test_every_figure_is_plausible_and_has_a_source(name: str) -> None:
    imu = load_imu(name)
    for figures in (imu.gyro, imu.accel):
        for key in figures.__struct_fields__:
            figure = getattr(figures, key)
            assert figure.value > 0
            assert len(figure.source) > 10, key
    degree, gee = np.radians(1.0), 9.80665
    assert 1e-3 * degree < imu.gyro.noise_density.si < 0.03 * degree
    assert 50e-6 * gee < imu.accel.noise_density.si < 500e-6 * gee
    assert imu.gyro.residual_bias.si < imu.gyro.offset.si
    assert imu.accel.residual_bias.si < imu.accel.offset.si
    assert 1000 * degree < imu.gyro.full_scale.si < 5000 * degree
    assert 8 * gee <= imu.accel.full_scale.si <= 40 * gee


def test_units_are_converted() -> None:
    imu = load_imu("icm-42688-p")
    assert imu.gyro.noise_density.si == pytest.approx(4.887e-5, rel=1e-3)  # rad/s/√Hz of 2.8 mdps/√Hz
    assert imu.accel.noise_density.si == pytest.approx(6.865e-4, rel=1e-3)  # m/s²/√Hz of 70 µg/√Hz
    model = imu.model(gyro_step=1e-3)
    assert model.gyro.noise_density == imu.gyro.noise_density.si
    assert model.gyro.step == 1e-3
    assert model.accel.full_scale == pytest.approx(16 * 9.80665)


def test_a_part_of_ones_own_and_what_is_wrong_with_it(tmp_path: Path) -> None:
    text = (data_folder("config") / "imu" / "bmi088.toml").read_text(encoding="utf-8")
    own = tmp_path / "mine.toml"
    own.write_text(text, encoding="utf-8")
    assert load_imu(own) == load_imu("bmi088")
    own.write_text(text.replace("dps/√Hz", "furlongs"), encoding="utf-8")
    with pytest.raises(SettingsError, match="furlongs"):
        load_imu(own)
    own.write_text("name = ", encoding="utf-8")
    with pytest.raises(SettingsError, match=r"mine\.toml"):
        load_imu(own)
    with pytest.raises(InputError, match="choose one of adis16470"):
        load_imu("hal-9000")
