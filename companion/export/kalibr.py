"""An IMU's noise as Kalibr's imu.yaml (github.com/ethz-asl/kalibr, wiki "Yaml formats" and "IMU Noise Model")."""

from __future__ import annotations

from companion.analysis import ImuNoise, noise_model


def kalibr_text(noise: ImuNoise, origin: str) -> str:
    """The text of imu.yaml. Kalibr's densities are those of `strapdown`: a sample at rate r has the deviation N √r."""
    gyro, accel = noise_model(noise)
    lines = [f"# IMU noise of {noise.imu} from {origin}".replace("\n", " ")]
    for title, name, sensor, unit in (
        ("Accelerometers", "accelerometer", accel, "m/s^2"),
        ("Gyroscopes", "gyroscope", gyro, "rad/s"),
    ):
        lines += [
            f"# {title}",
            f"{name}_noise_density: {sensor.white.value:.4e}  # {unit}/sqrt(Hz): {sensor.white.source}",
            f"{name}_random_walk: {sensor.walk.value:.4e}  # {unit}/sqrt(s): {sensor.walk.source}",
        ]
    lines += ["rostopic: /imu0  # the topic of your bag", f"update_rate: {noise.rate_hz:.1f}  # Hz"]
    return "\n".join(lines) + "\n"
