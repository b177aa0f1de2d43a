"""Clocks that are set while a session goes on: the vehicle's, and our own."""

from __future__ import annotations

import time

import pytest

from companion.app.live import Attachment, Watch
from companion.comparison import Integration
from companion.links import Link, Session
from companion.mavlink import Packer
from companion.simulate import SimulatedVehicle
from tests.links.peers import UdpPeer, udp_peer
from tests.simulated import flying
from tests.waiting import wait_for

pytestmark = pytest.mark.slow

G_MG = -1000


def watch() -> Watch:
    return Watch(dialect="ardupilotmega", dequantise=False, how=lambda _: Integration(), horizons=(1.0,))


class Sitting:
    """A vehicle at rest whose clock can be set."""

    def __init__(self, peer: UdpPeer) -> None:
        self.boot_ms = 20_000
        self._peer, self._packer = peer, Packer(1, 1)

    def sit(self, seconds: float) -> None:
        for i in range(round(seconds * 50)):
            self.boot_ms += 20
            imu = {"time_usec": 1000 * self.boot_ms, "zacc": G_MG}
            packets = self._packer.pack("RAW_IMU", imu) + self._packer.pack("ATTITUDE", {"time_boot_ms": self.boot_ms})
            packets += self._packer.pack("LOCAL_POSITION_NED", {"time_boot_ms": self.boot_ms, "z": -1.0})
            if i % 50 == 0:
                packets += self._packer.pack("HEARTBEAT", {"type": 2, "autopilot": 3, "mavlink_version": 3})
            self._peer.send(packets)
            time.sleep(0.004)  # five times as fast as the clock says


@pytest.mark.parametrize("step_ms", [-1400, 41_000])
def test_a_vehicles_clock_that_is_set_is_no_reboot_and_no_motion(step_ms: int) -> None:
    watching = watch()
    with (
        Link("udpin:127.0.0.1:0", listen_only=True) as link,
        udp_peer(link.port) as peer,
        Attachment(Session(link)) as attachment,
    ):
        vehicle = Sitting(peer)

        def now() -> float:
            watching.receive(attachment.fetch())
            seen = watching.look()
            assert seen is None or seen.free is None or abs(seen.free.position_error).max() < 0.5
            return seen.present.replay.t[-1] if seen else 0.0

        vehicle.sit(2.5)
        wait_for(lambda: now() > 22.0)
        vehicle.boot_ms += step_ms
        vehicle.sit(3.0)
        wait_for(lambda: now() > vehicle.boot_ms * 1e-3 - 0.5)
        assert not [sentence for sentence in attachment.notices() if "rebooted" in sentence]


def test_our_own_clock_may_be_set_back_and_forth(monkeypatch: pytest.MonkeyPatch) -> None:
    watching, real = watch(), time.time
    with Link("udpin:127.0.0.1:0") as link, flying(link.port, since=8.0) as vehicle, Attachment(Session(link)) as heard:
        for step_s in (-3600.0, 1e8):
            monkeypatch.setattr(time, "time", lambda step_s=step_s: real() + step_s)
            sooner = vehicle.t

            def caught_up(vehicle: SimulatedVehicle = vehicle, sooner: float = sooner) -> bool:
                watching.receive(heard.fetch())
                seen = watching.look()
                return seen is not None and seen.present.replay.t[-1] > sooner + 0.5 and vehicle.t > sooner

            wait_for(caught_up)
