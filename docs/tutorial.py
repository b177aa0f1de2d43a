# %% [markdown]
# # A flight, step by step
# A script with cells: run it whole in the project's folder (`python docs/tutorial.py`), or cell by cell in VS Code,
# Spyder or Jupyter. Lines that begin with `# >` are what a cell prints.

# %%
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np

import companion as c

flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
print(f"{flight.vehicle.autopilot} {flight.vehicle.type}, {flight.duration:.1f} s")
for name, track in flight.imus.items():
    print(f"{name}: {len(track)} samples at {track.rate_hz:.1f} Hz")

# > ARDUPILOTMEGA QUADROTOR, 101.5 s
# > RAW_IMU: 10121 samples at 100.0 Hz
# > SCALED_IMU2: 2531 samples at 25.0 Hz

# %% [markdown]
# ## The verdict
# What `companion analyze` prints is one call. The drift is the median over all windows of that length: the IMU alone,
# started from the autopilot's state. The expected drift is one standard deviation of what such an IMU may be off by.

# %%
examined = c.examine(flight)
found = examined.assessment
print(found.verdict.status, "-", textwrap.fill(found.verdict.summary, 100))
for row, expected in zip(found.drift.rows, found.expected, strict=True):
    if row.position_m is not None and expected is not None:
        print(f"{row.horizon_s:4g} s: {row.position_m.median:5.2f} m, expected {expected.position_m:6.2f} m")

# > consistent - IMU and autopilot agree within the expected error (98 % of 46 windows of 2 s inside the 95 % bound,
# > known errors removed; no sensor fault: 99.0 %). Not excluded: a gyro bias of 5.0-7.2 mrad/s or an
# > accelerometer bias of 0.20-0.25 m/s².
# >    1 s:  0.02 m, expected   0.27 m
# >    2 s:  0.05 m, expected   0.41 m
# >    5 s:  0.21 m, expected   2.22 m
# >   10 s:  0.99 m, expected  12.87 m
# >   30 s:  5.06 m, expected 299.51 m

# %% [markdown]
# ## How the drift grows
# A wrong velocity at the start moves the position in proportion to t, a constant accelerometer bias to t², and a
# constant gyro bias to t³, for it leans gravity over. The slope between one horizon and the next, on logarithmic axes,
# says which of them rules. Here it stays well below 3: no gyro bias does, although that is most of what was expected
# after 5 s.

# %%
rows = [row for row in found.drift.rows if row.position_m is not None]
horizons = np.array([row.horizon_s for row in rows])
medians = np.array([row.position_m.median for row in rows if row.position_m is not None])
slopes = np.diff(np.log(medians)) / np.diff(np.log(horizons))
print("position error grows with t to the power of", ", ".join(f"{slope:.1f}" for slope in slopes))

# > position error grows with t to the power of 1.2, 1.6, 2.3, 1.5

# %% [markdown]
# ## An error put in by hand is found
# From 100 s on the gyro has a bias of 10 mrad/s (0.6 °/s) about the right axis.

# %%
imu = flight.imu()
added = np.where(imu.t[:, None] > 100.0, [0.0, 0.010, 0.0], 0.0)
spoiled = replace(flight, imus={imu.source: replace(imu, gyro=imu.gyro + added)})
suspect = c.examine(spoiled).assessment
print(suspect.verdict.status, "-", textwrap.fill(suspect.verdict.summary, 100))

# > imu_suspect - Suspect the IMU: gyro y bias 9.9 ± 0.4 mrad/s, from 100.2 ± 0.2 s to the end (probability over 99.9
# > %).

# %% [markdown]
# ## An error from the first second on is calibration
# The same error throughout the log is no fault: every calibration leaves some bias. The verdict stays *consistent*, and
# the calibration tells it.

# %%
biased = replace(flight, imus={imu.source: replace(imu, gyro=imu.gyro + np.array([0.0, 0.010, 0.0]))})
calibrated = c.examine(biased).assessment
print(calibrated.verdict.status)
if calibrated.calibration is not None and found.calibration is not None:
    more = (calibrated.calibration.correction.gyro_bias - found.calibration.correction.gyro_bias)[1]
    print(f"gyro bias y: {1e3 * more:.1f} mrad/s more than before")

# > consistent
# > gyro bias y: 10.0 mrad/s more than before

# %% [markdown]
# ## Before and after
# Window by window: by how much is it worse, and is that more than windows differ? There are too few windows of
# 30 s to say so of them.

# %%
compared = c.contrast(found, suspect, same_flight=True)
for pair in compared.rows:
    change = pair.changes["attitude"]
    print(f"{pair.a.horizon_s:4g} s: {change.ratio:4.1f} times the attitude error: {change.direction}")

# >    1 s:  4.4 times the attitude error: worse
# >    2 s:  4.4 times the attitude error: worse
# >    5 s:  5.0 times the attitude error: worse
# >   10 s:  5.1 times the attitude error: worse
# >   30 s:  6.8 times the attitude error: same

# %% [markdown]
# ## Out into other tools
# The same tables as arrays and as files, which are written into this folder. With pyarrow
# (`pip install 'mavlink-companion[export]'`).

# %%
shown = c.replay(flight, reanchor_s=10)
tables = c.export.tables(flight, shown, found)
reckoning = tables["reckoning"]
known = reckoning["autopilot_known"] == 1
error = np.column_stack([reckoning[f"position_error_{axis}_m"][known] for axis in ("north", "east", "down")])
print(f"APE (rmse) by the table: {np.sqrt((error**2).sum(axis=1).mean()):.3f} m")
if (position := c.ape(shown).position_m) is not None:
    print(f"APE (rmse) by c.ape: {position.rmse:.3f} m")
for path in c.export.write_parquet(Path(), {name: tables[name] for name in ("reckoning", "windows")}):
    print("written:", path)

# > APE (rmse) by the table: 0.750 m
# > APE (rmse) by c.ape: 0.750 m
# > written: reckoning.parquet
# > written: windows.parquet
