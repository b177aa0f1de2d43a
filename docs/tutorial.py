# %% [markdown]
# # A flight, step by step
# A script with cells: run it whole (`python docs/tutorial.py`), or cell by cell in VS Code, Spyder or Jupyter.

# %%
from dataclasses import replace
from pathlib import Path

import numpy as np

import companion as c

LOG = Path("tlogs/copter-demo-100hz.tlog")
flight = c.open_log(LOG)[0]
print(f"{flight.vehicle.autopilot} {flight.vehicle.type}, {flight.duration:.1f} s")
for name, track in flight.imus.items():
    print(f"  {name}: {len(track)} samples at {track.rate_hz:.1f} Hz")

# %% [markdown]
# ## The verdict
# What `companion analyze` prints is one call.

# %%
examined = c.examine(flight)
found = examined.assessment
print(found.verdict.status.upper(), found.verdict.summary)
for row, expected in zip(found.drift.rows, found.expected, strict=True):
    if row.position_m is not None and expected is not None:
        print(f"  {row.horizon_s:4g} s: {row.position_m.median:7.3f} m, expected {expected.position_m:7.3f} m (1σ)")

# %% [markdown]
# ## How the drift grows
# A constant gyro bias leans gravity over: position error goes with t³; with a constant accelerometer bias it goes with
# t². The slope of the medians on double logarithmic axes says which rules.

# %%
rows = [row for row in found.drift.rows if row.position_m is not None]
horizons = np.array([row.horizon_s for row in rows])
medians = np.array([row.position_m.median for row in rows if row.position_m is not None])
print(
    "growth of the position error: t to the power of", np.round(np.diff(np.log(medians)) / np.diff(np.log(horizons)), 1)
)

# %% [markdown]
# ## An error put in by hand is found
# 5 mrad/s about the right axis: the calibration should say so, and the verdict suspect the IMU.

# %%
imu = flight.imu()
wrong = replace(imu, gyro=imu.gyro + np.array([0.0, 0.005, 0.0]))
spoiled = replace(flight, imus={imu.source: wrong})
suspect = c.examine(spoiled).assessment
print(suspect.verdict.status.upper(), suspect.verdict.summary)
if suspect.calibration is not None and found.calibration is not None:
    moved = suspect.calibration.values[1] - found.calibration.values[1]
    print(f"  gyro bias about y: {1e3 * moved:.2f} mrad/s more than before, put in: 5.00")

# %% [markdown]
# ## Before and after
# Window by window: by how much is it worse, and is that more than windows differ?

# %%
held = c.contrast(found, suspect, same_flight=True)
for pair in held.rows:
    change = pair.changes["attitude"]
    print(f"  {pair.a.horizon_s:4g} s: {change.ratio:.1f} times the attitude error: {change.direction}")

# %% [markdown]
# ## Out into other tools
# The same tables as arrays, as Arrow, as files. With pyarrow (`pip install 'mavlink-companion[export]'`).

# %%
shown = c.replay(flight, reanchor_s=10)
tables = c.export.tables(flight, shown, found)
reckoning = tables["reckoning"]
known = reckoning["autopilot_known"] == 1
error = np.column_stack([reckoning[f"position_error_{axis}_m"][known] for axis in ("north", "east", "down")])
print(f"APE from the table: {np.sqrt((error**2).sum(axis=1).mean()):.6f} m, by c.ape: {c.ape(shown).position_m}")
for path in c.export.write_parquet(Path(), {name: tables[name] for name in ("reckoning", "windows")}):
    print("  written:", path, f"{path.stat().st_size:,} bytes")
