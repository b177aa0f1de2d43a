"""A PX4 ULog → its flight: the topics, and one module for each kind of track made of them."""

from companion.telemetry.ulog.flight import ulog_flight

__all__ = ["ulog_flight"]
