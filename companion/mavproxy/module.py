"""What MAVProxy calls: packets as they come, `idle_task` again and again, and the command `companion`."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from MAVProxy.modules.lib import mp_module, mp_settings, mp_util, multiproc

from companion.app.running_verdict import Assignment, RunningVerdict
from companion.app.settings import Settings
from companion.mavlink import Decoder, load_dialect
from companion.model import IMU_MESSAGES, words
from companion.verdict import LiveVerdict

_HAND_OVER_S = 0.25
_RATE_S = 5.0  # over which the rate of the IMU is counted
_LANE = re.compile(r"EKF\d (?:IMU\d )?lane switch (\d)|EKF\d? primary changed: ?(\d)", re.ASCII)
_COLOURS = {"consistent": "green", "imu_suspect": "red", "autopilot_suspect": "red", "lost": "red"}  # of the text


def init(mpstate: Any) -> Companion:
    """Called by MAVProxy when the module is loaded."""
    return Companion(mpstate)


class Companion(mp_module.MPModule):  # type: ignore[misc]  # MAVProxy has no types
    """Hands what arrives to a process of its own that judges it, and shows what that says."""

    def __init__(self, mpstate: Any) -> None:
        super().__init__(mpstate, "companion", "verdict on IMU and autopilot")
        self.options = mp_settings.MPSettings([("popup", bool, True)])
        self.add_command(
            "companion", self.command, "verdict on IMU and autopilot", ["status", "set (COMPANIONSETTING)"]
        )
        self.add_completion_function("(COMPANIONSETTING)", self.options.completion)
        self._decoder = Decoder(load_dialect(), stamped=False)
        self._verdict = RunningVerdict(Assignment(Settings()))
        self._received: list[bytes] = []
        self._handed = self._counted = time.monotonic()
        self._counts = Counter[str]()
        self._rates: dict[str, float] = {}
        self._lane = "-"
        self._status, self._alarm = "", 0.0  # as shown: the state, and when its last alarm began

    def mavlink_packet(self, m: Any) -> None:
        """A packet of the vehicle, as it came."""
        kind = m.get_type()
        if kind == "BAD_DATA":
            return
        self._received.append(bytes(m.get_msgbuf()))
        if kind in IMU_MESSAGES:
            self._counts[kind] += 1
        elif kind == "STATUSTEXT" and (match := _LANE.search(m.text)):
            self._lane = match[1] or match[2]

    def idle_task(self) -> None:
        """Hand over what has come, and show what is new."""
        now = time.monotonic()
        if now - self._handed < _HAND_OVER_S:
            return
        self._handed = now
        if self._received:
            frames = self._decoder.push(b"".join(self._received))
            self._received.clear()
            self._verdict.receive([(frames, time.time())])
        if now - self._counted >= _RATE_S:
            self._rates = {kind: count / (now - self._counted) for kind, count in self._counts.items()}
            self._counts.clear()
            self._counted = now
        self._show(self._verdict.read())

    def unload(self) -> None:
        """End the process that judges."""
        self._verdict.close()
        self.remove_command("companion")
        super().unload()

    def command(self, arguments: Sequence[str]) -> None:
        """`companion [status]`: the verdict now and since it was loaded. `companion set popup False`: no pop-ups."""
        if arguments[:1] == ["set"]:
            self.options.command(list(arguments[1:]))
            return
        one = self._verdict.read()
        (status, text), (so_far, text_so_far) = one.now, one.so_far
        rates = ", ".join(f"{kind} {rate:.0f} Hz" for kind, rate in self._rates.items()) or "none yet"
        print(f"companion: {words(status or 'no verdict yet')}: {text}")
        print(f"companion: so far {words(so_far or 'nothing')}: {text_so_far}")
        print(f"companion: IMU messages: {rates}; EKF lane announced: {self._lane}")

    def _show(self, one: LiveVerdict) -> None:
        status, _ = one.now
        named = words(status) or "waiting"
        self.console.set_status("Companion", f"Companion: {named}", row=4, fg=_COLOURS.get(status, "black"))
        fastest = max(self._rates, key=lambda kind: self._rates[kind], default="")
        imu = f"{fastest} {self._rates[fastest]:.0f} Hz" if fastest else "-"
        self.console.set_status("CompanionImu", f"IMU: {imu}  Lane: {self._lane}", row=4)
        alarm = one.alarms[-1] if one.alarms else None
        if alarm is not None and alarm.first > self._alarm:
            self._alarm = alarm.first
            self.say(f"companion: {words(alarm.status).upper()}: {alarm.text}")
            if self.options.popup and mp_util.has_wxpython:
                window = multiproc.Process(target=pop_up, args=(f"companion: {words(alarm.status)}", alarm.text))
                window.daemon = True  # MAVProxy does not wait for it when it ends
                window.start()
        elif status == "consistent" and self._status != status and one.alarms:
            self.say("companion: IMU and autopilot agree again")
        self._status = status


def pop_up(title: str, text: str) -> None:
    """A window with a button, in a process of its own as MAVProxy's windows are."""
    mp_util.child_close_fds()
    from MAVProxy.modules.lib.wx_loader import wx  # noqa: PLC0415

    app = wx.App(False)
    wx.MessageBox(text, title, wx.OK | wx.ICON_WARNING)
    del app
