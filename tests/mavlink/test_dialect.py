"""Layouts agree with the XML that pymavlink's dialects were generated from."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pymavlink
import pytest

from companion.mavlink import dialect_names, load_dialect, mode_name
from companion.model import SettingsError

SIZES = {"char": 1, "int8_t": 1, "uint8_t": 1, "uint8_t_mavlink_version": 1, "int16_t": 2, "uint16_t": 2}
SIZES |= {"int32_t": 4, "uint32_t": 4, "float": 4, "int64_t": 8, "uint64_t": 8, "double": 8}


def _lengths(message: ET.Element) -> tuple[int, int]:
    """Payload bytes without and with extension fields, counted in the XML."""
    total, base = 0, None
    for child in message:
        if child.tag == "extensions":
            base = total
        elif child.tag == "field":
            kind, count = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", child.attrib["type"]).groups()  # type: ignore[union-attr]
            total += SIZES[kind] * int(count or 1)
    return (total if base is None else base), total


def test_lengths_are_those_of_the_xml_for_every_message_of_every_dialect() -> None:
    every = load_dialect("all")
    checked = 0
    for path in sorted((Path(pymavlink.__file__).parent / "dialects" / "v20").glob("*.xml")):
        for message in ET.parse(path).iter("message"):
            layout = every.by_id.get(int(message.attrib["id"]))
            if layout is not None and layout.name == message.attrib["name"]:
                assert (layout.min_length, layout.max_length) == _lengths(message), layout.name
                checked += 1
    assert checked >= 350


def test_raw_imu_in_wire_order_with_units() -> None:
    layout = load_dialect().by_name["RAW_IMU"]
    assert (layout.id, layout.crc_extra, layout.min_length, layout.max_length) == (27, 144, 26, 29)
    assert layout.dtype["time_usec"] == np.dtype("<u8")
    assert layout.dtype["xacc"] == np.dtype("<i2")
    assert layout.fields[-2:] == ("id", "temperature")
    assert (layout.units["xacc"], layout.units["xgyro"], layout.units["temperature"]) == ("mG", "mrad/s", "cdegC")


def test_text_and_arrays() -> None:
    dialect = load_dialect()
    assert dialect.by_name["PARAM_VALUE"].dtype["param_id"] == np.dtype("S16")
    assert dialect.by_name["ATTITUDE_QUATERNION"].dtype["repr_offset_q"].shape == (4,)


@pytest.mark.parametrize("name", dialect_names())
def test_every_dialect_of_pymavlink_loads(name: str) -> None:
    dialect = load_dialect(name)
    assert dialect.name == name
    assert dialect.crc_extra[-1] == -1


def test_enums() -> None:
    dialect = load_dialect()
    names = dialect.enum_names("MAV_AUTOPILOT")
    assert names[3] == "ARDUPILOTMEGA"
    assert names[12] == "PX4"
    assert not any(name.endswith("ENUM_END") for name in names.values())


def test_vehicles_have_the_names_of_mavlink_and_the_modes_of_a_plane() -> None:
    kinds = load_dialect().enum_names("MAV_TYPE")
    assert (kinds[1], kinds[20], kinds[22]) == ("FIXED_WING", "VTOL_TAILSITTER_QUADROTOR", "VTOL_FIXEDROTOR")
    assert {mode_name(load_dialect(), "ARDUPILOTMEGA", kinds[kind], 19) for kind in (1, *range(19, 25))} == {"QLOITER"}


def test_unknown_names_say_which_are_near() -> None:
    with pytest.raises(SettingsError, match="ardupilotmega"):
        load_dialect("ardupilot")
    with pytest.raises(SettingsError, match="MAV_AUTOPILOT"):
        load_dialect().enum_names("MAV_AUTOPILOTS")
