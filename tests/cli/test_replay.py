"""`companion replay`: what a client hears is what the vehicle in the log said, byte for byte and at its pace."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion
from companion.cli import main
from companion.links import open_port, parse_address, play, transports
from companion.logs import read_tlog
from companion.mavlink import load_dialect
from tests.processes import COMPANION, ended, next_line, started
from tests.recordings import BUNDLED
from tests.simulated import free_port
from tests.tlogs import Writer
from tests.waiting import meanwhile, wait_for

pytestmark = pytest.mark.slow

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")


def recorded(path: Path, seconds: float = 2.0) -> Path:
    """A vehicle at rest; a ground station, and a computer on board, that command it."""
    log = Writer(path / "a.tlog")
    log.rest(seconds)
    log.heartbeat(seconds, autopilot=8, kind=6, sysid=255, compid=190)
    for sysid, compid in ((255, 190), (1, 191)):
        log.send(
            seconds, "command_long", sysid=sysid, compid=compid, target_system=1, target_component=1, command=400,
            confirmation=0, param1=1, param2=0, param3=0, param4=0, param5=0, param6=0, param7=0,
        )  # fmt: skip
    log.rest(0.2, begin=seconds + 0.02, boot=20.02 + seconds)
    return log.close()


def frames(path: Path, *, sender: tuple[int, int] | None = (1, 1)) -> list[bytes]:
    """The frames of a log without their stamps, in order."""
    data = path.read_bytes()
    found = []
    at = 0
    while at + 10 <= len(data) and at + 20 + data[at + 9] <= len(data):  # it may still be growing
        size = data[at + 9] + 12
        frame = data[at + 8 : at + 8 + size]
        if sender in (None, (frame[5], frame[6])):
            found.append(frame)
        at += 8 + size
    return found


class Client(threading.Thread):
    """Hears UDP packets, each with the time it came."""

    def __init__(self) -> None:
        super().__init__()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.address = f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"
        self.heard: list[tuple[float, bytes]] = []
        self.over = threading.Event()

    def run(self) -> None:
        while True:
            over = self.over.is_set()  # all has been sent: what is still in the socket is heard
            try:
                self.heard.append((time.monotonic(), self.socket.recv(4096)))
            except TimeoutError:
                if over:
                    return


@contextlib.contextmanager
def client() -> Iterator[Client]:
    one = Client()
    one.start()
    try:
        yield one
    finally:
        one.over.set()
        one.join()
        one.socket.close()


@contextlib.contextmanager
def connected(port: int, buffer: int | None = None) -> Iterator[socket.socket]:
    """A client of a server, as soon as it listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as end:
        if buffer:
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        wait_for(lambda: end.connect_ex(("127.0.0.1", port)) == 0)
        yield end


def test_a_client_hears_the_vehicle_byte_for_byte_and_at_its_pace(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = recorded(tmp_path)
    with client() as ears:
        assert main(["replay", str(log), ears.address, "--speed", "2"]) == 0
    assert [frame for _, frame in ears.heard] == frames(log)
    begin, middle, end = (ears.heard[i][0] for i in (0, len(ears.heard) // 2, -1))
    assert end - begin > 0.6, "2.2 s at twice the pace; a machine under load may be slower, never faster"
    assert middle - begin > 0.2, "spread over the time, not in one go at the end"
    said = capsys.readouterr()
    assert "left out" in said.err
    assert "255:190 (2), 1:191 (1)" in said.err
    assert "RAW_IMU" in said.out


def test_a_clock_that_is_set_is_not_waited_for(tmp_path: Path) -> None:
    """A computer without a battery begins in 1970 and has the date once a GPS or a network tells it."""
    writer = Writer(tmp_path / "a.tlog")
    writer.rest(0.4, begin=-1.69e9)
    writer.heartbeat(1.5e9)  # one damaged stamp
    writer.rest(0.4, boot=20.5)
    log = writer.close()
    until = time.monotonic() + 10.0
    with client() as ears:
        port = open_port(parse_address(ears.address))
        play(log, port, load_dialect(), stop=lambda: time.monotonic() > until)
        port.close()
    assert [data for _, data in ears.heard] == frames(log)
    assert 0.75 < ears.heard[-1][0] - ears.heard[0][0] < 5.0, "each part at its pace"


def test_everybody_sends_what_others_said_too(tmp_path: Path) -> None:
    log = recorded(tmp_path)
    with client() as ears:
        assert main(["replay", str(log), ears.address, "--speed", "50", "--everybody"]) == 0
    assert [frame for _, frame in ears.heard] == frames(log, sender=None)


def test_a_server_waits_for_its_client(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, port, heard = recorded(tmp_path), free_port(), bytearray()

    def connect() -> None:
        with connected(port) as end:
            while piece := end.recv(65536):
                heard.extend(piece)

    with meanwhile(connect):
        assert main(["replay", str(log), f"tcpin:127.0.0.1:{port}", "--speed", "20"]) == 0
    assert bytes(heard) == b"".join(frames(log))
    assert "nobody has connected; waiting" in capsys.readouterr().err


def test_a_client_that_does_not_read_is_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, port, heard = recorded(tmp_path, 30.0), free_port(), bytearray()
    sent = frames(log)

    def connect() -> None:
        with connected(port, buffer=4096) as end:
            time.sleep(0.5)  # does not read, while all the rest is due
            while piece := end.recv(65536):
                heard.extend(piece)

    def small(end: socket.socket) -> None:
        prepare(end)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)

    prepare = transports._prepare
    monkeypatch.setattr(transports, "_prepare", small)
    with meanwhile(connect):
        assert main(["replay", str(log), f"tcpin:127.0.0.1:{port}", "--speed", "1000"]) == 0
    assert bytes(heard) == b"".join(sent)
    assert f"sent {len(sent):,} frames" in capsys.readouterr().out


def test_what_nobody_was_there_to_hear_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, port = recorded(tmp_path), free_port()

    def connect() -> None:
        with connected(port) as end:
            end.recv(100)

    with meanwhile(connect):
        assert main(["replay", str(log), f"tcpin:127.0.0.1:{port}", "--speed", "4"]) == 0
    said = capsys.readouterr()
    unheard = int(re.search(r"([\d,]+) frames more were due while nobody was there", said.err)[1])  # type: ignore[index]
    sent = int(re.search(r"sent ([\d,]+) frames", said.out)[1])  # type: ignore[index]
    assert unheard > 0
    assert sent + unheard == len(frames(log))


def test_companion_records_a_replay_as_it_was(tmp_path: Path) -> None:
    """A client that the tool itself is: it listens only, and its recording holds the same messages."""
    log, port = recorded(tmp_path, 3.0), free_port()
    words = ["record", f"udpin:127.0.0.1:{port}", "--listen-only", "-o", str(tmp_path / "b.tlog")]
    with started(*COMPANION, *words) as process:
        assert "Recording" in next_line(process, process.stderr)
        assert main(["replay", str(log), f"udpout:127.0.0.1:{port}", "--speed", "4"]) == 0
        wait_for(lambda: len(frames(tmp_path / "b.tlog")) == len(frames(log)))
        ended(process, signal.SIGINT)
    ours, theirs = (read_tlog(path).messages["RAW_IMU"] for path in (tmp_path / "b.tlog", log))
    assert ours.rows.tobytes() == theirs.rows.tobytes()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([DEMO, "/dev/ttyACM0:115200"], "does not send to a serial port"),
        ([DEMO, "udpout:127.0.0.1:9", "--speed", "0"], "--speed lies above 0"),
        ([DEMO, "nowhere"], "is not a link"),
        (["bin", "udpout:127.0.0.1:9"], "is not a telemetry log"),
        (["raw", "udpout:127.0.0.1:9"], "has no time stamps"),
        (["gcs", "udpout:127.0.0.1:9"], "no vehicle found in"),
    ],
)
def test_what_cannot_be_replayed_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], reason: str
) -> None:
    (tmp_path / "bin").write_bytes(b"\xa3\x95\x80\x80" + bytes(100))
    (tmp_path / "raw").write_bytes(b"".join(frames(recorded(tmp_path))))
    log = Writer(tmp_path / "gcs")
    for i in range(20):
        log.heartbeat(i, autopilot=8, kind=6, sysid=255, compid=190)
    log.close()
    words = [str(tmp_path / word) if word in ("bin", "raw", "gcs") else word for word in words]
    assert main(["replay", *words]) == 2
    assert reason in capsys.readouterr().err


def test_nothing_but_the_command_can_replay() -> None:
    """What speaks with vehicles goes through the allow-list of `requests`, and has no way to this."""
    package = Path(companion.__file__).parent
    imported = re.compile(r"from companion\.links[\w.]* import (\([^)]*|[^(\n]*)\bplay\b")
    modules = [path for path in package.rglob("*.py") if imported.search(path.read_text(encoding="utf-8"))]
    users = {path.relative_to(package).as_posix() for path in modules}
    assert users == {"links/__init__.py", "cli/senders.py"}
