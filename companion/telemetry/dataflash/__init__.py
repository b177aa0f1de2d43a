"""ArduPilot's on-board log (.bin) → its flight: IMUs, the estimator's own solution, and the sensors that aid it."""

from companion.telemetry.dataflash.flight import RECORDS, dataflash_flight, why_no_flight
