"""What made a row: a digest of the program's analysis and of the settings. Rows of another version are made anew."""

from __future__ import annotations

import functools
import hashlib
from importlib.resources import files
from pathlib import Path

import msgspec

from companion.app.sensors import load_imu_spec
from companion.app.settings import Settings, data_folder

MAKING = {
    "model", "mavlink", "logs", "telemetry", "strapdown", "estimation", "analysis", "app.blas", "app.toml_file",
    "app.settings", "app.sensors", "app.correction", "app.recording", "app.examination", "documents", "fleet",
}  # fmt: skip
"""The parts of the program that a row comes out of."""

_SHOWING = ("view", "live")  # settings that change no number


def version_of(settings: Settings, imu: str | None, imu_model: str | None) -> str:
    """A digest of everything that the rows of a log depend on, beside the log.

    Raises InputError or SettingsError for an imu_model that is none.
    """
    known = msgspec.to_builtins(settings)
    for section in _SHOWING:
        known.pop(section, None)
    figures = repr(load_imu_spec(imu_model)) if imu_model else None
    asked = msgspec.json.encode([_program_version(), known, imu, figures], order="sorted")
    return hashlib.sha256(asked).hexdigest()[:16]


@functools.cache
def _program_version() -> str:
    """A digest of the source that makes the numbers, so that any change of it is noticed, released or not."""
    package = Path(str(files("companion")))
    parts = tuple(f"{part}." for part in MAKING)
    sources = [
        path for path in sorted(package.rglob("*.py")) if ".".join(path.relative_to(package).parts).startswith(parts)
    ]
    digest = hashlib.sha256()
    for path in [*sources, *sorted((data_folder("config") / "imu").glob("*.toml"))]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]
