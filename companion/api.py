"""The public names of `companion`: what a notebook imports."""

from typing import TYPE_CHECKING, Any

from companion import export
from companion.app.examination import Examination, examine, one_blas_thread
from companion.app.recording import open_log
from companion.app.settings import Settings, load_settings
from companion.comparison import (
    Calibration,
    Drift,
    DriftRow,
    Integration,
    Limits,
    PoseError,
    Replay,
    Statistic,
    ape,
    drift,
    replay,
    rpe,
)
from companion.estimation import BestEstimate
from companion.estimation import smooth as _smooth
from companion.model import (
    AttitudeTrack,
    CompanionError,
    DataError,
    Epoch,
    Event,
    Flight,
    ImuTrack,
    InputError,
    MessageStats,
    NavState,
    Origin,
    PositionTrack,
    Series,
    SettingsError,
    StatusText,
    Trajectory,
    Vehicle,
    from_euler,
)
from companion.pages.notebook import OpenReplay, show
from companion.strapdown import dead_reckon, quaternion
from companion.verdict import Assessment, Contrast, Finding, Verdict, contrast

if TYPE_CHECKING:
    from companion.report import plot_drift, plot_errors, plot_path

smooth = one_blas_thread(_smooth)
to_euler = quaternion.to_euler

__all__ = [
    "Assessment", "AttitudeTrack", "BestEstimate", "Calibration", "CompanionError", "Contrast", "DataError", "Drift",
    "DriftRow", "Epoch", "Event", "Examination", "Finding", "Flight", "ImuTrack", "InputError", "Integration",
    "Limits", "MessageStats", "NavState", "OpenReplay", "Origin", "PoseError", "PositionTrack", "Replay", "Series",
    "Settings", "SettingsError", "Statistic", "StatusText", "Trajectory", "Vehicle", "Verdict", "ape", "contrast",
    "dead_reckon", "drift", "examine", "export", "from_euler", "load_settings", "open_log", "plot_drift",
    "plot_errors", "plot_path", "replay", "rpe", "show", "smooth", "to_euler",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """The charts, loaded when the first is requested: the report draws them, and loads the viewer with itself."""
    if not name.startswith("plot_") or name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from companion import report  # noqa: PLC0415

    return getattr(report, name)
