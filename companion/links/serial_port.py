"""Bytes over a serial line, by pyserial."""

from __future__ import annotations

import contextlib
import errno
import time
from typing import Any

from companion.links.ports import Address, BackOff, NotThereError

_WAIT_S = 0.05  # that a read waits for its first byte


class SerialPort:
    """A serial device, which may be unplugged and plugged in again."""

    def __init__(self, address: Address) -> None:
        import serial  # noqa: PLC0415  (only who has a cable needs it)

        self._library: Any = serial
        self._address = address
        self._retry = BackOff()
        self._first = b""  # read while waiting
        try:
            self._serial: Any = self._open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise NotThereError(_why_not(address, error)) from None

    @property
    def problem(self) -> str:
        return "" if self._serial is not None else f"{self._address.device} has gone; waiting for it to come back"

    def wait(self, timeout_s: float) -> bool:
        if self._serial is None:
            self._serial = self._retry.attempt(self._open, timeout_s)
            if self._serial is None:
                return False
        # pyserial's own waiting, because Windows cannot select on a serial line.
        until = time.monotonic() + timeout_s
        while self._serial is not None and not self._first:
            self._first = self._take(1)
            if time.monotonic() >= until:
                break
        return bool(self._first)

    def read(self) -> bytes:
        data, self._first = self._first + self._take(), b""
        return data

    def write(self, data: bytes) -> bool:
        if self._serial is None:
            return False
        try:
            self._serial.write(data)
        except self._library.SerialTimeoutException:  # the line is full; what we ask will be asked again
            return False
        except OSError:
            self._lose()
        return self._serial is not None

    def close(self) -> None:
        self._lose()

    def _open(self) -> Any:
        return self._library.Serial(
            self._address.device, self._address.baud, timeout=_WAIT_S, write_timeout=0.2, exclusive=True
        )

    def _take(self, count: int | None = None) -> bytes:
        """So many bytes, waiting a moment for them; None: those that are there."""
        if self._serial is None:
            return b""
        try:
            count = self._serial.in_waiting if count is None else count
            return bytes(self._serial.read(count)) if count else b""
        except (OSError, TypeError):  # TypeError: pyserial's file descriptor became None under it
            self._lose()
            return b""

    def _lose(self) -> None:
        if self._serial is not None:
            with contextlib.suppress(OSError):  # it has gone already
                self._serial.close()
            self._serial = None


def _why_not(address: Address, error: OSError | ValueError) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        return f"there is no device {address.device}: plug the vehicle in, and look for it with: ls /dev/tty*"
    if number == errno.EACCES:
        return f"no permission for {address.device}: add yourself to its group (often dialout), then log in again."
    if number in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error):
        return f"{address.device} is taken: another program has it open. Close that program."
    if isinstance(error, ValueError):
        return f"{address.device} cannot run at {address.baud} baud ({error})."
    return f"{address.device} cannot be opened ({error})."
