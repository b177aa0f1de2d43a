"""What an estimator's status says of its position."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.telemetry.aiding import has_position
from tests.tlogs import Writer

RATIOS = dict.fromkeys(
    ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio", "hagl_ratio", "tas_ratio", "pos_horiz_accuracy",
     "pos_vert_accuracy"), 0.1,
)  # fmt: skip
VARIANCES = dict.fromkeys(
    ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance", "terrain_alt_variance"), 0.1
)


@pytest.mark.parametrize(("valid", "lost"), [(831, 167), (8, 7), (16, 0)])  # 831, 167: as ArduPilot says it
@pytest.mark.parametrize("message", ["ekf_status_report", "estimator_status"])
def test_a_position_counts_where_its_estimator_calls_it_valid(
    tmp_path: Path, message: str, valid: int, lost: int
) -> None:
    log = Writer(tmp_path / "flight.tlog")
    for t in np.arange(0.0, 20.0, 0.5):
        flags = lost if 8.0 <= t < 15.0 else valid
        fields: dict[str, Any] = VARIANCES if message == "ekf_status_report" else RATIOS
        clock = {} if message == "ekf_status_report" else {"time_usec": round((20.0 + t) * 1e6)}
        log.send(t, message, flags=flags, **fields, **clock)
        log.rest(0.48, begin=t, boot=20.0 + t)
    flight = c.open_log(log.close())[0]
    assert flight.position is not None
    t = flight.position.t - 20.0
    assert not ((t > 8.1) & (t < 14.9)).any()
    assert ((t < 7.9) | (t > 15.1)).sum() >= 0.99 * (7.9 + 4.9) * 50
    assert any("position is not valid" in note for note in flight.notes)


def test_without_a_status_every_position_counts() -> None:
    t = np.arange(5.0)
    assert has_position(t, np.zeros(0), np.zeros(0)).all()
    assert has_position(t, t, np.full(5, np.nan)).all()


def test_a_status_holds_until_the_next_and_the_first_also_before() -> None:
    t = np.arange(10.0)
    assert has_position(t, np.array([2.5, 5.5]), np.array([0.0, 16.0])).tolist() == [False] * 6 + [True] * 4
