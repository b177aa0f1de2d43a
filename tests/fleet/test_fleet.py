"""`companion fleet` as its users run it: on a cluster of its own and on a scheduler's, to the end and interrupted."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import msgspec
import numpy as np
import psutil
import pytest

from companion.app.settings import Settings
from companion.cli import main
from companion.fleet import TIMEOUT_S, FleetRun, FoundLog, run, run_fleet
from companion.fleet.journal import Journal, LogRecord, Plan, version_of
from companion.fleet.rows import arrow_tables, rows_of
from companion.fleet.run import write_results
from companion.fleet.task import decode, examine_log, limited
from companion.installation import data_folder
from companion.model import InputError
from tests.fleet.conftest import copies, table, with_workers
from tests.processes import ended
from tests.recordings import BUNDLED
from tests.tlogs import Writer
from tests.waiting import wait_for

pytestmark = pytest.mark.slow

Captured = pytest.CaptureFixture[str]
TABLES = ("flights", "drift", "findings", "calibration")


def refused(arguments: list[str], capsys: Captured) -> str:
    assert main(["fleet", *arguments]) == 2
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return said.err


def times(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def done(logs: Path, cluster: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the logs, from a scheduler in a process of its own."""
    folder = tmp_path_factory.mktemp("done") / "results"
    assert main(["fleet", str(logs), "-o", str(folder), "--scheduler", with_workers(cluster)]) == 0
    return folder


def test_every_flight_is_a_row_and_every_bad_log_too(done: Path) -> None:
    rows = {(Path(row["log"]).name, row["boot"]): row for row in table(done)}
    assert rows.keys() == {
        *((f"flight{i:03}.tlog", 1) for i in range(3)),
        ("demo.tlog", 1),
        ("two boots.tlog", 1),
        ("two boots.tlog", 2),
        ("empty.tlog", None),
        ("garbage.tlog", None),
    }
    assert "empty" in rows["empty.tlog", None]["error"]
    assert "not a flight log" in rows["garbage.tlog", None]["error"]
    demo = rows["demo.tlog", 1]
    assert (demo["status"], demo["error"], demo["imu"]) == ("consistent", None, "RAW_IMU")
    assert demo["date"].isoformat().startswith("2026-")
    assert dict(demo["gyro_ids"]) == {"RAW_IMU": 2752772, "SCALED_IMU2": 2752780}
    assert demo["board"] == "3d1219c7c4c5404aaa1f6d2a48adfda4"


def test_the_numbers_are_those_of_analyze(done: Path, capsys: Captured) -> None:
    assert main(["analyze", str(BUNDLED / "copter-demo-100hz.tlog"), "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    drift = [row for row in table(done, "drift") if row["log"].endswith("demo.tlog")]
    assert [row["horizon_s"] for row in drift] == [row["horizon_s"] for row in flight["drift"]]
    for row, expected in zip(drift, flight["drift"], strict=True):
        assert row["windows"] == expected["windows"]
        for name, unit in (("attitude", "deg"), ("velocity", "mps"), ("position", "m")):
            for part in ("median", "p95", "max"):
                assert row[f"{name}_{part}_{unit}"] == expected[f"{name}_{unit}"][part]
            assert row[f"{name}_expected_{unit}"] == expected["expected"][f"{name}_{unit}"]
    (fit,) = [row for row in table(done, "calibration") if row["log"].endswith("demo.tlog")]
    for i, axis in enumerate("xyz"):
        assert fit[f"gyro_bias_{axis}_radps"] == flight["calibration"]["gyro_bias_radps"]["value"][i]
        assert fit[f"accel_bias_{axis}_sigma_mps2"] == flight["calibration"]["accel_bias_mps2"]["sigma"][i]
    assert 20 < fit["temperature_degc"] < 50
    assert (fit["gyro_id"], fit["accel_id"]) == (2752772, 2753028)
    found = [row for row in table(done, "findings") if row["log"].endswith("demo.tlog")]
    assert [row["evidence"] for row in found] == [f["evidence"] for f in flight["verdict"]["findings"]]


def test_only_what_is_new_or_changed_is_done(
    scheduler: str, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, out = tmp_path / "logs", tmp_path / "results"
    copies(own, 2)[1].rename(own / "demo.tlog")
    for bad in ("empty.tlog", "garbage.tlog"):
        (own / bad).write_bytes(bad.encode().removeprefix(b"empty.tlog"))
    command = ["fleet", str(own), "-o", str(out), "--scheduler", scheduler]

    def said() -> str:
        assert main(command) == 0
        return capsys.readouterr().out.splitlines()[0]

    assert "4 examined, 0 unchanged" in said()
    before = times(out)
    with monkeypatch.context() as patch:  # without Dask: it is not even imported
        patch.setitem(sys.modules, "distributed", None)
        assert "0 examined, 4 unchanged" in said()
    assert times(out) == before, "nothing is written when nothing has changed"
    content = bytearray((own / "flight000.tlog").read_bytes())
    content[5000] ^= 1
    (own / "flight000.tlog").write_bytes(content)
    shutil.copy(own / "demo.tlog", own / "new.tlog")
    assert "2 examined, 3 unchanged" in said()
    demo, copy = (next(row for row in table(out) if row["log"].endswith(name)) for name in ("demo.tlog", "new.tlog"))
    assert demo == copy | {"log": demo["log"]}, "known content under another name"
    (own / "new.tlog").unlink()
    assert "0 examined, 4 unchanged" in said()
    assert len(table(out)) == 4, "the tables are of the logs that were named"
    command.append("--retry")
    assert "2 examined, 2 unchanged" in said()
    command[-1:] = ["--imu", "RAW_IMU"]
    assert "4 examined, 0 unchanged" in said(), "other settings, other rows"


def test_a_log_that_kills_its_workers_is_a_row(scheduler: str, tmp_path: Path) -> None:
    """With a scheduler that gives up at the first death, which blames innocent logs too."""
    paths = copies(tmp_path / "logs", 4)
    paths[1].rename(tmp_path / "logs" / "deadly.tlog")
    out = tmp_path / "results"
    assert main(["fleet", str(tmp_path / "logs"), "-o", str(out), "--scheduler", scheduler]) == 0
    errors = {Path(row["log"]).name: row["error"] for row in table(out)}
    assert "died" in errors.pop("deadly.tlog")
    assert set(errors.values()) == {None}
    assert len(errors) == 3


def test_a_log_that_a_worker_does_not_see_is_a_row_and_tried_again(scheduler: str, tmp_path: Path) -> None:
    asked = FleetRun(tmp_path, Settings(), scheduler=scheduler)
    elsewhere = [FoundLog("/on/another/host.tlog", 100, "1-1")]
    for _ in range(2):
        found = run_fleet(asked, elsewhere)
        (row,) = found.rows.flights
        assert "/on/another/host.tlog cannot be read" in row["error"]
        assert "under the same path" in row["error"]
        assert found.examined == 1


def test_logs_that_no_worker_finishes_are_rows_and_tried_again(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies(tmp_path / "logs", 3)
    command = ["fleet", str(tmp_path / "logs"), "-o", str(tmp_path / "out"), "--scheduler", scheduler]
    with monkeypatch.context() as patient:
        patient.setattr(run, "_SPARE_S", -2 * TIMEOUT_S)  # nobody is waited for
        assert main(command) == 0
    assert all("no worker has finished any log" in row["error"] for row in table(tmp_path / "out"))
    assert main(command) == 0
    assert [row["error"] for row in table(tmp_path / "out")] == [None] * 3


@pytest.mark.parametrize("error", [RuntimeError("the loop is closed"), TimeoutError(), asyncio.CancelledError()])
def test_a_scheduler_that_does_not_answer_is_one_sentence_and_loses_nothing(
    error: BaseException, scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    waited = run._patiently

    def one(*how: Any) -> Iterator[Any]:
        yield next(waited(*how))
        raise error

    monkeypatch.setattr(run, "_patiently", one)
    copies(tmp_path / "logs", 3)
    said = refused([str(tmp_path / "logs"), "-o", str(tmp_path / "out"), "--scheduler", scheduler], capsys)
    assert f"the scheduler does not answer ({error!s}" in said
    assert [row["error"] for row in table(tmp_path / "out")] == [None]


def test_a_worker_with_another_version_is_told(
    scheduler: str, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.fleet.run.version_of", lambda *_: "another")
    assert main(["fleet", str(logs / "demo.tlog"), "-o", str(tmp_path), "--scheduler", scheduler]) == 0
    assert "another version of companion" in table(tmp_path)[0]["error"]


def test_reports_are_written_and_linked(scheduler: str, logs: Path, tmp_path: Path, capsys: Captured) -> None:
    command = ["fleet", str(logs / "two boots.tlog"), "-o", str(tmp_path), "--scheduler", scheduler, "--reports"]
    assert main(command) == 0
    pages = [row["report"] for row in table(tmp_path)]
    assert len(set(pages)) == 2
    html = (tmp_path / "fleet.html").read_text()
    for page in pages:
        assert f'href="./{page}"' in html
        assert "two boots.tlog" in (tmp_path / page).read_text()
    assert main(command) == 0
    assert "0 examined" in capsys.readouterr().out
    (tmp_path / pages[0]).unlink()
    assert main(command) == 0
    assert "1 examined" in capsys.readouterr().out
    assert (tmp_path / pages[0]).exists()


class Running:
    """The command in a process group of its own, as a terminal runs it."""

    def __init__(self, logs: Path, out: Path, workers: int) -> None:
        command = [sys.executable, "-m", "companion", "fleet", str(logs), "-o", str(out), "--workers", str(workers)]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        journal = out / "fleet.jsonl"

        def begun() -> bool:
            assert self.process.poll() is None, self.process.communicate()
            return journal.exists() and journal.read_bytes().count(b"\n") >= 3

        wait_for(begun, "three logs are done")

    def workers(self) -> list[psutil.Process]:
        found = psutil.Process(self.process.pid).children(recursive=True)
        told = [(child, " ".join(child.cmdline())) for child in found]
        copies = [c for c, name in told if "multiprocessing.forkserver" in name and c.ppid() != self.process.pid]
        return copies or [child for child, name in told if "spawn_main" in name]

    def end(self) -> tuple[int, str, str]:
        out, err = ended(self.process)
        return self.process.returncode, out, err


@pytest.mark.skipif(os.name == "nt", reason="needs signals")
def test_a_local_cluster_gives_the_same_tables_though_a_worker_is_killed(
    done: Path, logs: Path, tmp_path: Path
) -> None:
    running = Running(logs, tmp_path / "results", workers=2)
    running.workers()[0].send_signal(signal.SIGKILL)
    code, out, err = running.end()
    assert (code, err) == (0, "")
    assert "7 logs: 7 examined, 0 unchanged" in out
    assert "garbage.tlog: " in out
    assert {row["error"] for row in table(tmp_path / "results") if row["boot"]} == {None}
    for name in TABLES:
        assert table(tmp_path / "results", name) == table(done, name)


@pytest.mark.skipif(os.name == "nt", reason="needs signals")
def test_ctrl_c_keeps_what_is_done(tmp_path: Path, capsys: Captured, scheduler: str) -> None:
    copies(tmp_path / "logs", 8)
    running = Running(tmp_path / "logs", tmp_path / "results", workers=1)
    workers = running.workers()
    os.killpg(running.process.pid, signal.SIGINT)
    code, out, err = running.end()
    assert code == 130
    assert "run the same command again to resume" in err
    assert "Traceback" not in err
    kept = len(table(tmp_path / "results"))
    assert 3 <= kept < 8
    assert f"8 logs: {kept} examined" in out
    assert not [worker for worker in workers if worker.is_running()]
    assert main(["fleet", str(tmp_path / "logs"), "-o", str(tmp_path / "results"), "--scheduler", scheduler]) == 0
    assert f"{8 - kept} examined, {kept} unchanged" in capsys.readouterr().out
    assert len(table(tmp_path / "results")) == 8


def no_library(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize("library", ["distributed", "pyarrow"])
def test_a_missing_library_gets_the_line_that_installs_it(
    library: str, logs: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_library(monkeypatch, library)
    assert "[fleet]'" in refused([str(logs), "-o", str(tmp_path)], capsys)


def test_nobody_at_the_address(logs: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "_CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense://127.0.0.1:9", "127.0.0.1:notaport"):
        said = refused([str(logs), "-o", str(tmp_path), "--scheduler", address], capsys)
        assert f"no Dask scheduler at {address}" in said


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["{empty}", "-o", "{empty}/r"], "no logs in"),
        (["{empty}/no.tlog", "-o", "{empty}/r"], "no file or folder"),
        (["{logs}", "-o", "{logs}/demo.tlog"], "cannot write"),
        (["{logs}", "-o", "{empty}", "--imu-model", "bmi99"], "no IMU model"),
        (["{logs}", "-o", "{empty}", "--config", "{empty}/no.toml"], "settings file"),
    ],
)
def test_what_a_user_can_mend(
    arguments: list[str], expected: str, logs: Path, tmp_path: Path, capsys: Captured
) -> None:
    assert expected in refused([part.format(logs=logs, empty=tmp_path) for part in arguments], capsys)


@pytest.mark.parametrize("count", ["0", "-1", "two"])
def test_a_wrong_number_of_workers(count: str, logs: Path, tmp_path: Path, capsys: Captured) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["fleet", str(logs), "-o", str(tmp_path), "--workers", count])
    assert stop.value.code == 2
    assert "--workers" in capsys.readouterr().err


def test_a_flight_that_has_no_report_to_write_is_not_examined_again_for_it(tmp_path: Path) -> None:
    log = Writer(tmp_path / "no imu.tlog")
    for t in range(20):
        log.heartbeat(t)
        log.attitude(t, boot=t)
    log.close()
    settings, out = Settings(), tmp_path / "out"
    out.mkdir()
    packed = msgspec.msgpack.encode(settings)
    plan = Plan(version=version_of(settings, None, None), settings=packed, folder=str(out))
    record = decode(examine_log(str(tmp_path / "no imu.tlog"), plan))
    assert [(flight.error, flight.report_error) for flight in record.flights] == [(None, None)]
    journal = Journal(out, plan.version)
    journal.add(found := FoundLog(str(tmp_path / "no imu.tlog"), 1, "1-1"), record)
    assert run_fleet(FleetRun(out, settings, reports=True), [found]).examined == 0


def test_a_worker_reads_a_noise_specification_again_that_was_edited(tmp_path: Path) -> None:
    part = tmp_path / "part.toml"
    (tmp_path / "empty.tlog").touch()
    text = (data_folder("config") / "imu" / "bmi088.toml").read_text()
    for content in (text, text.replace("0.014", "0.02")):
        part.write_text(content)
        packed = msgspec.msgpack.encode(Settings())
        plan = Plan(version=version_of(Settings(), None, str(part)), settings=packed, imu_model=str(part))
        assert "empty" in str(decode(examine_log(str(tmp_path / "empty.tlog"), plan)).error)


def test_what_no_table_or_calendar_has_is_a_row(tmp_path: Path) -> None:
    """Whatever a log says, a worker's answer can be written."""
    log = Writer(tmp_path / "odd.tlog")
    log.send(0, "param_value", param_id=b"INS_GYR_ID", param_value=1.2e19, param_type=9, param_count=1, param_index=0)
    log.send(0, "system_time", time_unix_usec=4_000_000_000_000_000, time_boot_ms=20_000)
    log.rest(8.0)
    log.close()
    settings = Settings()
    plan = Plan(version=version_of(settings, None, None), settings=msgspec.msgpack.encode(settings))
    record = decode(examine_log(str(tmp_path / "odd.tlog"), plan))
    assert record.sha256
    assert [flight.error for flight in record.flights] == [None]
    assert record.flights[0].gyro_ids == {}
    rows = rows_of([(FoundLog(str(tmp_path / "odd.tlog"), 1, ""), record)])
    assert len(rows.flights) == 1
    assert arrow_tables(rows)["flights"].num_rows == 1
    assert write_results(tmp_path, [(FoundLog("odd.tlog", 1, ""), record)], {})


def test_a_page_that_cannot_be_drawn_costs_no_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> str:
        raise ValueError("year 148163 is out of range")

    monkeypatch.setattr("companion.fleet.run.fleet_html", broken)
    failed = LogRecord(error="bad")
    assert write_results(tmp_path, [(FoundLog("a.tlog", 1, ""), failed)], {})
    assert [row["error"] for row in table(tmp_path)] == ["bad"]
    assert "year 148163" in (tmp_path / "fleet.html").read_text()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is limited on Linux")
def test_a_log_that_needs_more_memory_than_it_is_given_is_an_error_of_its_own() -> None:
    with pytest.raises(MemoryError), limited(0.1, 60.0):
        np.ones(50_000_000)
    assert np.ones(50_000_000).sum() == 50_000_000, "and of no other"


def test_a_log_that_takes_longer_than_it_is_given_is_an_error_of_its_own() -> None:
    def work() -> None:
        while True:
            with contextlib.suppress(Exception):  # as much that is lenient with damage does
                time.sleep(0.01)

    with pytest.raises(InputError, match=r"longer than the 0.2 s .* --timeout"), limited(4.0, 0.2):
        work()


def test_what_a_full_disk_left_half_written_is_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the logs are those of the run before: each file has to be of them, not one for all."""
    failed = LogRecord(error="bad")
    first, second = (FoundLog("a.tlog", 1, ""), failed), (FoundLog("b.tlog", 1, ""), failed)
    assert write_results(tmp_path, [first], {})
    with monkeypatch.context() as patch:
        patch.setattr(run, "arrow_table", Mock(side_effect=InputError("no space left.")))
        with pytest.raises(InputError, match="no space left"):
            write_results(tmp_path, [first, second], {})
    assert write_results(tmp_path, [first], {})
    assert "b.tlog" not in (tmp_path / "fleet.html").read_text()
    assert write_results(tmp_path, [first], {}) == []


def test_text_of_a_log_is_no_formula_in_a_table() -> None:
    rows = rows_of([(FoundLog("=HYPERLINK(1).tlog", 1, "1-1"), LogRecord(sha256="1", error="@SUM(A1)"))])
    (row,) = arrow_tables(rows)["flights"].to_pylist()
    assert (row["log"], row["error"]) == ("'=HYPERLINK(1).tlog", "'@SUM(A1)")
