"""ArduPilot's on-board log (.bin) → its flights: IMUs, the estimator's own solution, and the sensors that aid it."""

from companion.telemetry.dataflash.flight import RECORDS, dataflash_flights, why_no_flight
