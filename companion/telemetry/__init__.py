"""MAVLink messages, DataFlash records and ULog topics → tracks: SI units, FRD and NED, one clock per flight."""

from companion.telemetry.dataflash import RECORDS, dataflash_flights, why_no_flight
from companion.telemetry.flights import NEEDED, flights
from companion.telemetry.parameters import id_parameters
from companion.telemetry.sdlog2 import SDLOG2_RECORDS, is_sdlog2, sdlog2_flight
from companion.telemetry.split import NonVehicle
from companion.telemetry.stream import Stream
from companion.telemetry.ulog import TOPICS, ulog_flight
