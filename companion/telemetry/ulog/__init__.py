"""A PX4 ULog → its flight: the topics, and one module for each kind of track made of them."""

from companion.telemetry.ulog.flight import TOPICS, ulog_flight
