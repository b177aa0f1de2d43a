"""Findings about settings of the estimator that the flight contradicts: declination, GPS delay, place of the antenna.

Each is known to the best estimate from the sensors alone. What is found is said with the value to set; it accuses
nobody: what it did to the estimate is found as such.

Also here: the parameters of the vehicle that say how a sensor sits and how late it is: their names, and what would mend
them.

ArduPilot: AP_AHRS (AHRS_ORIENTATION turns every IMU of the board, and its internal compasses), AP_Compass
(COMPASS_ORIENT, of external ones alone; AP_Compass_Backend.cpp, rotate_field). PX4: SENS_BOARD_ROT, and CAL_MAGn_ROT,
-1 for an internal compass (lib/sensor_calibration/Magnetometer.cpp). Both take a reading by it into the body.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.comparison import (
    Limits,
    attitude_error,
    ends_of,
    flown,
    length,
    phases,
    reference_at,
    within_any,
    wrapped,
)
from companion.constants import check, harm, healthy, num
from companion.estimation import ATTITUDE, CONSTANTS, BestEstimate, field_at, hypothesis_of, receiver_of
from companion.model import ORIENTATIONS, Array, Flight, orientation_name, orientation_number, orientations
from companion.strapdown import quaternion
from companion.verdict.finding import Finding


def parameter(flight: Flight, *names: str) -> tuple[str, float] | None:
    """The first of these that the log has, and its value when it began; None where it has none."""
    return next(((name, flight.parameters[name]) for name in names if name in flight.parameters), None)


def board_orientation(flight: Flight) -> str:
    """What the orientation of the board is called; in general words at an autopilot that is not known."""
    return _named(flight, "AHRS_ORIENTATION", "SENS_BOARD_ROT", "the orientation of the board")


def _named(flight: Flight, ardupilot: str, px4: str, other: str) -> str:
    """What a parameter is called by the flight's autopilot."""
    return {"ARDUPILOTMEGA": ardupilot, "PX4": px4}.get(flight.vehicle.autopilot, other)


def compass_orientation(flight: Flight, instance: int) -> str:
    """The same of a compass."""
    number = "" if instance == 0 else str(instance + 1)
    return _named(flight, f"COMPASS_ORIENT{number}", f"CAL_MAG{instance}_ROT", "the orientation of the compass")


def is_internal(flight: Flight, instance: int) -> bool | None:
    """Whether a compass turns with the board; None where the log does not tell."""
    number = "" if instance == 0 else str(instance + 1)
    external = parameter(flight, f"COMPASS_EXTERN{number}", f"COMPASS_EXTERNAL{number}")
    if external is not None:
        return external[1] == 0.0
    rotation = parameter(flight, f"CAL_MAG{instance}_ROT")
    return None if rotation is None else rotation[1] < 0.0


def mended(flight: Flight, name: str, turn: Array, turned_by: str = "") -> str:
    """The value of an orientation by which its readings would be turned further by a rotation (4,), in words.

    turned_by: what its readings are turned by now, where that is another parameter. Where the log does not have what is
    set now, the turn itself; where that, or the value, is none of the list, the name alone.
    """
    now = flight.parameters.get(turned_by or name, np.nan)
    if not 0 <= now < len(ORIENTATIONS):
        further, apart = orientation_number(turn)
        listed = apart < check.ORIENTATION_EXACT_RAD
        return f"{name} (turned further by {orientation_name(further)})" if listed else name
    number, apart = orientation_number(quaternion.multiply(turn, orientations()[int(now)]))
    if apart > check.ORIENTATION_EXACT_RAD:
        return name
    now_set = "" if turned_by else f"; now {now:g}"
    return f"{name} to {number} ({orientation_name(number)}{now_set})"


def setting_findings(flight: Flight, best: BestEstimate, limits: Limits) -> Iterator[Finding]:
    """Those of a flight; its IMU has to fit the other sensors, which tell nothing else."""
    if best.contradicted:
        return
    for setting in (_declination(flight, best, limits), _gps_delay(flight, best), _antenna(flight, best)):
        if setting is not None:
            kind, evidence, advice = setting
            yield Finding(kind, "data", "warning", *ends_of(best.t), evidence, advice)


def _declination(flight: Flight, best: BestEstimate, limits: Limits) -> tuple[str, str, str] | None:
    """A heading that is off by as much as the declination that is set, or by all of it where none is.

    An estimator that looks the declination up takes no notice of what is set: then its heading is not off.
    """
    earth = field_at(best.origin or flight.origin, flight.epoch)
    error = _heading_error(flight, best, limits)
    if earth is None or error is None:
        return None
    off, sigma = error
    name, declination = _set_declination(flight)
    expected = (0.0 if declination is None else declination) - earth.declination
    apart = abs(float(wrapped(np.array(off - expected))))
    if abs(expected) < harm.DECLINATION_RAD or apart > num.SIGMAS * sigma or abs(off) < 2.0 * apart:
        return None
    of_place = np.degrees(earth.declination)
    if declination is None and abs(off) < num.SIGMAS * sigma:
        return None
    what = f"as if no declination were used: it is {of_place:.1f}° here"
    if declination is not None:
        is_set = f"{name} is {np.degrees(declination):.1f}°"
        what = f"as the declination that is set says: {is_set}, and {of_place:.1f}° here"
    value = f"{earth.declination:.4f} (rad)" if name.startswith("COMPASS") else f"{of_place:.1f}°"
    turned = f"the autopilot's heading is off by {np.degrees(off):.1f} ± {np.degrees(sigma):.1f}°"
    evidence = f"{turned} since the start of the log, {what} by the World Magnetic Model"
    advice = f"Set {name} to {value}, or have it looked up: {_LOOKED_UP.get(name, 'by the place')}."
    return "declination", evidence, advice


_LOOKED_UP = {"COMPASS_DEC": "COMPASS_AUTODEC 1", "EKF2_MAG_DECL": "bit 0 of EKF2_DECL_TYPE"}


def _set_declination(flight: Flight) -> tuple[str, float | None]:
    """What it is called, and its value, rad, where the log has it and says that it is used."""
    own, degrees = parameter(flight, "COMPASS_DEC"), parameter(flight, "EKF2_MAG_DECL", "ATT_MAG_DECL")
    if own is not None:
        return own[0], own[1] if parameter(flight, "COMPASS_AUTODEC") == ("COMPASS_AUTODEC", 0.0) else None
    if degrees is not None:
        looked_up = int(flight.parameters.get("EKF2_DECL_TYPE", 0.0)) & 1
        return degrees[0], None if looked_up else float(np.radians(degrees[1]))
    return _named(flight, "COMPASS_DEC", "EKF2_MAG_DECL", "the declination"), None


def _heading_error(flight: Flight, best: BestEstimate, limits: Limits) -> tuple[float, float] | None:
    """By how much the autopilot's heading is off in the air, rad, and its 1σ; None where that changes.

    In the air, for on the ground a compass may be beside iron; of a vehicle that was not, throughout.
    """
    reference = reference_at(flight.require_attitude(), None, best.t, limits)
    aloft = flown(phases(flight)) or [(-np.inf, np.inf)]
    known = reference.attitude_known & within_any(best.t, aloft)
    if known.sum() < check.SETTING_KEYFRAMES:
        return None
    error = attitude_error(reference.q_ned_frd[known], best.q_ned_frd[known])[:, 2]
    middle = float(np.median(error))
    low, high = np.percentile(wrapped(error - middle), check.SETTING_PERCENTILES)
    if high - low > 2.0 * healthy.AP_SIGMA["heading"]:
        return None
    own = float(np.median(best.sigma(ATTITUDE)[known, 2]))
    return middle, float(np.hypot(own, healthy.AP_SIGMA["heading"]))


def _gps_delay(flight: Flight, best: BestEstimate) -> tuple[str, str, str] | None:
    """A GPS that is later than is set, by the vehicle's own log: on a link a fix may be stamped when it is sent."""
    number = _receiver_number(flight, best)
    earlier = f"GPS_DELAY_MS{'' if number == 1 else number}"
    setting = parameter(flight, f"GPS{number}_DELAY_MS", earlier, "EKF2_GPS_DELAY")
    measured = _well_observed(best, "gps_latency")
    changes = any(one.kind == "gps_latency" for one in best.explained)
    if setting is None or measured is None or not flight.on_board or changes:
        return None
    name, value = setting
    of_driver = value == 0.0 and name != "EKF2_GPS_DELAY"  # ArduPilot takes what is known of the receiver then
    low, high = healthy.GPS_DRIVER_DELAY_S if of_driver else (1e-3 * value, 1e-3 * value)
    latency, sigma = float(measured[0][0]), float(measured[1][0])
    off = max(latency - high, low - latency)
    swift = _swift(best)
    if off < max(num.SIGMAS * sigma, hypothesis_of("gps_latency").min_reported) or off * swift < harm.GPS_DELAY_M:
        return None
    is_set = f"0, the receiver's usual {1e3 * low:.0f}-{1e3 * high:.0f}" if of_driver else f"{value:g}"
    late = f"the GPS fixes are {1e3 * latency:.0f} ± {1e3 * sigma:.0f} ms late, and {name} is {is_set}"
    evidence = f"{late}: at {swift:.0f} m/s the estimate is {off * swift:.1f} m off"
    return "gps_delay", evidence, f"Set {name} to {max(10.0 * round(100.0 * latency), 1.0):.0f} (ms)."


def _swift(best: BestEstimate) -> float:
    """How fast the vehicle was when it was fast, m/s, over ground."""
    return float(np.percentile(length(best.velocity[:, :2]), check.SETTING_SWIFT))


def _antenna(flight: Flight, best: BestEstimate) -> tuple[str, str, str] | None:
    """An antenna that sits elsewhere than is set, by more than positions that are later than velocities would make.

    The estimate has one latency of both; at the speed of a fixed wing some hundredths of a second are a lever arm.
    """
    measured = _well_observed(best, "lever_arm")
    number, imu_place = _receiver_number(flight, best), f"INS_POS{best.imu.instance + 1}"
    places = (f"GPS{number}_POS", imu_place), (f"GPS_POS{number}", imu_place), ("EKF2_GPS_POS", "EKF2_IMU_POS")
    names = next((one for one in places if f"{one[0]}_X" in flight.parameters), None)
    if measured is None or names is None:
        return None
    antenna, imu = (np.array([flight.parameters.get(f"{n}_{axis}", 0.0) for axis in "XYZ"]) for n in names)
    lever, sigma = measured
    off = lever - (antenna - imu)
    least = max(harm.ANTENNA_M, CONSTANTS["gps_latency"][1] * _swift(best))
    if not (np.abs(off) > np.maximum(check.LEVER_SIGMAS * sigma, least)).any():
        return None
    sits = f"the GPS antenna sits ({_digits(lever)}) ± ({_digits(sigma)}) m from the IMU"
    evidence = f"{sits}, and ({_digits(antenna - imu)}) m is set"
    advice = f"Set {names[0]}_X, _Y, _Z to ({_digits(imu + lever)}), if it is mounted there."
    return "antenna_position", evidence, advice


def _digits(value: Array) -> str:
    """The components of a vector, m, in words."""
    return ", ".join(f"{v:z.2f}" for v in value)


def _receiver_number(flight: Flight, best: BestEstimate) -> int:
    """The number, from 1 on, that ArduPilot's parameters give to the receiver of the best estimate."""
    gps = receiver_of(flight, best.imu.t)
    return 1 if gps is None else gps.instance + 1


def _well_observed(best: BestEstimate, name: str) -> tuple[Array, Array] | None:
    """A constant of the flight and its 1σ, where the flight tells far more of it than was believed before."""
    place, believed = CONSTANTS[name]
    sigma = best.constants_sigma[place]
    observed = "gps_position" in best.residuals and (sigma < check.WELL_KNOWN * believed).all()
    return (best.states.constant(name), sigma) if observed else None
