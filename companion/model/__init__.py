"""The nouns: tracks, series, flights, errors, and the Earth they are on. NumPy alone, and no autopilot's name."""

from companion.model.aiding import (
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
from companion.model.errors import CompanionError, DataError, InputError, SettingsError
from companion.model.flight import Epoch, Flight, MessageStats, Origin, SettingNames, StatusText, Vehicle
from companion.model.geodesy import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    from_euler,
    geodetic_from_ned,
    ned_from_geodetic,
)
from companion.model.imu_messages import IMU_MESSAGES
from companion.model.notebook_repr import brief
from companion.model.quantities import Event, Series, interpolated, nearest, of_kind
from companion.model.tracks import STANDARD_GRAVITY, Array, AttitudeTrack, ImuTrack, NavState, PositionTrack, Trajectory
from companion.model.wording import counted

__all__ = [
    "ECCENTRICITY_SQUARED",
    "IMU_MESSAGES",
    "SEMI_MAJOR_AXIS",
    "STANDARD_GRAVITY",
    "ActuatorTrack",
    "AirspeedTrack",
    "Array",
    "AttitudeTrack",
    "BarometerTrack",
    "BiasTrack",
    "CompanionError",
    "CompassTrack",
    "ControlTrack",
    "DataError",
    "Epoch",
    "EstimatorReset",
    "Event",
    "Flight",
    "FlowTrack",
    "GpsTrack",
    "ImuTrack",
    "InputError",
    "MessageStats",
    "NavState",
    "Origin",
    "ParameterChange",
    "Phase",
    "PhaseKind",
    "PositionTrack",
    "RangeTrack",
    "ResetKind",
    "SensorInUse",
    "Series",
    "SettingNames",
    "SettingsError",
    "StatusText",
    "Trajectory",
    "TruthTrack",
    "Vehicle",
    "brief",
    "counted",
    "from_euler",
    "geodetic_from_ned",
    "interpolated",
    "nearest",
    "ned_from_geodetic",
    "of_kind",
]
