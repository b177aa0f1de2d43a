"""The nouns: tracks, series, flights, errors, and the Earth they are on. NumPy alone, and no autopilot's name."""

from companion.model.aiding import (
    PITCH_270,
    ActuatorTrack,
    AirspeedTrack,
    BarometerTrack,
    BiasTrack,
    CompassTrack,
    ControlTrack,
    EstimatorReset,
    FlowTrack,
    GpsTrack,
    ParameterChange,
    Phase,
    PhaseKind,
    RangeTrack,
    ResetKind,
    SensorInUse,
    TruthTrack,
)
from companion.model.checks import check_number, check_seconds, floats, is_number
from companion.model.errors import CompanionError, DataError, InputError, NoEstimateError, SettingsError
from companion.model.flight import (
    Epoch,
    Flight,
    MessageStats,
    Origin,
    SettingNames,
    StatusText,
    Vehicle,
    with_tracks,
    without,
)
from companion.model.geodesy import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    from_euler,
    geodetic_from_ned,
    ned_from_geodetic,
)
from companion.model.lanes import EstimatorLane
from companion.model.orientations import ORIENTATIONS, orientation_name, orientation_number, orientations
from companion.model.tracks import (
    GAP_PERIODS,
    GAP_S,
    IMU_MESSAGES,
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    Event,
    ImuTrack,
    NavState,
    PositionTrack,
    Series,
    Track,
    Trajectory,
    integrated,
    interpolated,
    longest_step,
    median,
    nearest,
    of_kind,
    percentile,
    rows,
    weighted_median,
)
from companion.model.wording import brief, counted, nearest_word, words
