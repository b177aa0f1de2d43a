"""What other tools read of an export: evo's own numbers, Arrow's metadata, MCAP's messages."""

from __future__ import annotations

import csv
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import msgspec
import numpy as np
import numpy.typing as npt
import pytest
from mcap.reader import make_reader

import companion as c
from companion.app.examination import examine
from companion.app.settings import Settings
from companion.cli import main
from companion.comparison import PoseError, ape, rpe
from companion.comparison.pose_error import Spread
from companion.export import FORMATS, assessed_replay, write_mcap
from companion.export.mcap import layout
from companion.strapdown import quaternion
from tests.recordings import BUNDLED, ROOT
from tests.tlogs import Writer, resting
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow

DEMO = BUNDLED / "copter-demo-100hz.tlog"

Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def flight() -> c.Flight:
    return c.open_log(DEMO)[0]


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The demo flight in a format, written once."""
    folder = tmp_path_factory.mktemp("export")

    def export(kind: str) -> Path:
        path = folder / kind
        if not path.exists():
            assert main(["export", str(DEMO), "--format", kind, "-o", str(path)]) == 0
        return path

    return export


_EVO = """
import json, sys
from evo import main_ape, main_rpe
from evo.core import metrics, sync
from evo.tools import file_interface
pair = sync.associate_trajectories(*map(file_interface.read_tum_trajectory_file, sys.argv[1:]))
parts = {"position_m": metrics.PoseRelation.translation_part, "attitude_deg": metrics.PoseRelation.rotation_angle_deg}
step = {"delta": 500, "delta_unit": metrics.Unit.frames, "support_loop": True}
ape = {part: main_ape.ape(*pair, relation).stats for part, relation in parts.items()}
rpe = {part: main_rpe.rpe(*pair, relation, **step).stats for part, relation in parts.items()}
print(json.dumps({"ape": ape, "rpe": rpe}))
"""


@pytest.fixture(scope="module")
def evo(exported: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What evo finds for the pair, by kind of error and part. It keeps settings in the home of whoever imports it."""
    folder = exported("tum")
    run = subprocess.run(
        [sys.executable, "-c", _EVO, str(folder / "autopilot.tum"), str(folder / "imu.tum")],
        env=os.environ | {"HOME": str(tmp_path_factory.mktemp("home"))},
        capture_output=True,
        check=True,
        timeout=LIMIT_S,
    )
    found: dict[str, Any] = json.loads(run.stdout)
    return found


@pytest.mark.parametrize("part", ["position_m", "attitude_deg"])
@pytest.mark.parametrize(("kind", "ours"), [("ape", ape), ("rpe", lambda shown: rpe(shown, 500))], ids=["ape", "rpe"])
def test_evo_finds_our_numbers(
    kind: str, ours: Callable[[c.Replay], PoseError], part: str, flight: c.Flight, evo: dict[str, Any]
) -> None:
    own = getattr(ours(c.replay(flight)), part)
    assert isinstance(own, Spread)
    assert own.rmse > 0.1
    for name in ("rmse", "mean", "median", "std", "min", "max"):
        assert evo[kind][part][name] == pytest.approx(getattr(own, name), abs=1e-6), name


def test_the_tum_files_say_their_frames(exported: Callable[[str], Path]) -> None:
    head = [line for line in (exported("tum") / "imu.tum").read_text().splitlines() if line.startswith("#")]
    assert "north, east, down" in head[2]
    assert "add 1795229517.827520 for UNIX time" in head[1]


def test_the_best_estimate_is_the_third_trajectory(flight: c.Flight, exported: Callable[[str], Path]) -> None:
    rows = np.loadtxt(exported("tum") / "best.tum")
    with (exported("csv") / "best_estimate.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(rows) == len(table) == len(flight.imu("RAW_IMU"))
    for place, name in ((1, "position_north_m"), (3, "position_down_m"), (7, "q_w")):
        assert np.allclose(rows[:, place], [float(row[name]) for row in table], atol=1e-8)
    assert flight.origin is not None
    assert float(table[0]["position_latitude_deg"]) == pytest.approx(np.degrees(flight.origin.latitude), abs=1e-4)
    assert float(table[0]["position_sigma_north_m"]) > 0


def test_csv_reads_back_as_the_tracks(flight: c.Flight, exported: Callable[[str], Path]) -> None:
    with (exported("csv") / "raw_imu.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    track = flight.imu("RAW_IMU")
    assert np.array_equal([float(row["t_s"]) for row in rows], track.t)
    assert np.array_equal([float(row["accel_z_mps2"]) for row in rows], track.accel[:, 2])
    assert flight.epoch is not None
    assert float(rows[0]["unix_s"]) == pytest.approx(flight.epoch.unix_s + track.t[0], abs=1e-6)


def test_angles_stand_beside_every_quaternion(flight: c.Flight, exported: Callable[[str], Path]) -> None:
    with (exported("csv") / "reckoning.csv").open(newline="") as file:
        row = list(csv.DictReader(file))[5000]
    shown = c.replay(flight)
    for name, q in (("imu", shown.q_imu[5000]), ("autopilot", shown.q_ref[5000])):
        angles = [float(row[f"{name}_{angle}_rad"]) for angle in ("roll", "pitch", "yaw")]
        assert abs(quaternion.from_euler(*angles) @ q) == pytest.approx(1.0), name
    with (exported("csv") / "parameters.csv").open(newline="") as file:
        values = {row["name"]: float(row["value"]) for row in csv.DictReader(file)}
    assert values == flight.parameters


def test_kml_is_the_path_on_earth(flight: c.Flight, exported: Callable[[str], Path]) -> None:
    tree = ElementTree.parse(exported("kml"))
    space = {"kml": "http://www.opengis.net/kml/2.2"}
    lines = {
        place.findtext("kml:name", namespaces=space): place.findtext("kml:LineString/kml:coordinates", "", space)
        for place in tree.iterfind(".//kml:Placemark", space)
    }
    assert set(lines) == {"Autopilot (EKF)", "IMU alone", "Best estimate"}
    gps = flight.series["gps"]
    for text in lines.values():
        first = [float(number) for number in text.split()[0].split(",")]
        assert first[:2] == pytest.approx(np.degrees([gps["lon_rad"][0], gps["lat_rad"][0]]), abs=5e-5)  # 5 m


def test_text_is_no_formula_and_a_date_that_is_not_known_is_empty(tmp_path: Path) -> None:
    """STATUSTEXT is untrusted: a spreadsheet would run =cmd|...; stamps of a log that jump tell no date."""
    log = Writer(tmp_path / "log.tlog")
    log.rest(20.0)
    log.send(1000.0, "statustext", severity=4, text=b"=cmd|'/c calc'!A0")
    log.send(2000.0, "attitude", time_boot_ms=40_100, roll=0, pitch=0, yaw=0, rollspeed=0, pitchspeed=0, yawspeed=0)
    path = log.close()
    flight = c.open_log(path)[0]
    found = c.export.tables(c.Flight(**{n: getattr(flight, n) for n in flight.__slots__} | {"epoch": None}))
    assert np.isnan(found["raw_imu"]["unix_s"]).all()
    c.export.write_csv(tmp_path, {"texts": found["texts"], "raw_imu": found["raw_imu"]})
    with (tmp_path / "texts.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["text"] == "'=cmd|'/c calc'!A0"
    assert row["unix_s"] == ""
    assert found["raw_imu"].arrow().column("unix_s").null_count == len(found["raw_imu"])


def test_parquet_states_units_and_frames(flight: c.Flight, exported: Callable[[str], Path]) -> None:
    from pyarrow import parquet  # noqa: PLC0415  (an extra, needed by this test alone)

    folder = exported("parquet")
    table = parquet.read_table(folder / "position.parquet")
    assert flight.position is not None
    assert np.array_equal(table["position_down_m"].to_numpy(), flight.position.position[:, 2])
    assert table.schema.field("velocity_east_mps").metadata == {b"unit": b"m/s", b"frame": b"NED"}
    assert table.schema.metadata[b"source"] == b"LOCAL_POSITION_NED"
    for path in folder.glob("*.parquet"):
        names = parquet.read_schema(path).names
        for name in names:
            unit = (parquet.read_schema(path).field(name).metadata or {}).get(b"unit")
            assert (unit is not None) == name.endswith(
                (
                    "_s",
                    "_m",
                    "_mps",
                    "_mps2",
                    "_rad",
                    "_radps",
                    "_deg",
                    "_degc",
                    "_tesla",
                    "_pa",
                    "_v",
                    "_a",
                    "_m2",
                    "_m2ps2",
                )
            ), f"{path.name}: {name}"


Topics = dict[str, list[tuple[str, int, dict[str, Any]]]]
"""Topic → its messages: schema, time in ns, content."""


def messages(path: Path) -> Topics:
    """What the mcap library reads of a file, each message held against its schema."""
    found: Topics = {}
    declared: dict[int, set[str]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            if schema.id not in declared:
                assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                text = json.loads(schema.data)
                assert text["title"] == schema.name
                declared[schema.id] = set(text["properties"])
            body = msgspec.json.decode(message.data)
            assert body.keys() == declared[schema.id]
            stamp = body["timestamp"]
            assert stamp["sec"] * 10**9 + stamp["nsec"] == message.log_time
            found.setdefault(channel.topic, []).append((schema.name, message.log_time, body))
    return found


@pytest.fixture(scope="module")
def topics(exported: Callable[[str], Path]) -> Topics:
    """The demo flight's."""
    return messages(exported("mcap"))


def test_mcap_reads_back(flight: c.Flight, topics: Topics) -> None:
    found = topics
    kinds = {topic: {schema for schema, _, _ in several} for topic, several in found.items()}
    assert {
        "/tf": {"foxglove.FrameTransform"},
        "/imu/pose": {"foxglove.PoseInFrame"},
        "/autopilot/location": {"foxglove.LocationFix"},
        "/best/location": {"foxglove.LocationFix"},
        "/imu/RAW_IMU": {"companion.Imu"},
        "/statustext": {"foxglove.Log"},
        "/findings": {"foxglove.Log"},
        "/paths": {"foxglove.SceneUpdate"},
        "/gps": {"companion.gps"},
    }.items() <= kinds.items()
    drawn = {entity["id"]: entity["lines"][0] for _, _, body in found["/paths"] for entity in body["entities"]}
    assert set(drawn) == {"autopilot", "imu", "best"}
    assert all(100 < len(line["points"]) <= 5000 for line in drawn.values())
    track = flight.imu("RAW_IMU")
    assert len(found["/imu/RAW_IMU"]) == len(track)
    assert flight.epoch is not None
    _, stamp, body = found["/imu/RAW_IMU"][100]
    assert stamp == round(flight.epoch.unix_s * 1e9) + round(track.t[100] * 1e9)
    assert list(body["specific_force"].values()) == track.accel[100].tolist()
    assert [body["message"] for _, _, body in found["/statustext"]] == [text.text for text in flight.texts]
    shown = c.replay(flight)
    _, _, body = found["/imu/pose"][5000]
    assert list(body["pose"]["position"].values()) == shown.position_imu[5000].tolist()
    assert [body["pose"]["orientation"][part] for part in "wxyz"] == shown.q_imu[5000].tolist()


def test_the_layout_shows_topics_that_there_are(topics: Topics) -> None:
    """Each panel is in the arrangement once, and draws a topic, and a field of it, that the file beside it has."""
    found, arranged = topics, layout(topics)
    panels = arranged["configById"]
    placed: list[str] = []
    waiting = [arranged["layout"]]
    while waiting:
        one = waiting.pop()
        if isinstance(one, str):
            placed.append(one)
        else:
            waiting += [one["first"], one["second"]]
    assert sorted(placed) == sorted(panels)
    scene = panels["3D!flight"]
    assert scene["topics"].keys() <= found.keys()
    assert scene["followTf"] in {body["child_frame_id"] for _, _, body in found["/tf"]}
    assert {panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel} <= found.keys()
    assert panels["map!flight"]["followTopic"] in found
    for value in (path["value"] for panel in panels.values() for path in panel.get("paths", ())):
        topic, _, part = value.partition(".")
        assert part in found[topic][0][2]


def turn_of(body: dict[str, Any]) -> npt.NDArray[np.float64]:
    return np.array([body["rotation"][part] for part in "wxyz"])


def test_foxglove_sees_the_vehicle_the_right_way_up(topics: Topics) -> None:
    """Composed through /tf, at the first instant: a level vehicle's up (z of FLU) is up in ENU, north is y."""
    transforms: dict[tuple[str, str], dict[str, Any]] = {}
    for _, _, body in topics["/tf"]:
        transforms.setdefault((body["parent_frame_id"], body["child_frame_id"]), body)
    chain = [("enu", "ned"), ("ned", "imu_frd"), ("imu_frd", "imu")]
    up, north = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    for link in reversed(chain):
        up = quaternion.rotate(turn_of(transforms[link]), up)
    assert up == pytest.approx([0, 0, 1], abs=1e-3), "the vehicle stands level on the ground"
    assert quaternion.rotate(turn_of(transforms["enu", "ned"]), north) == pytest.approx([0, 1, 0])
    bodies = ("autopilot", "imu", "best")
    assert {child for _, child in transforms} == {"ned", *bodies, *(f"{body}_frd" for body in bodies)}


def test_the_autopilot_is_where_its_gps_is(flight: c.Flight, topics: Topics) -> None:
    """Places on the map, made of NED and the origin, against the receiver's own: within 3 m, and 1 m at the median."""
    places = topics["/autopilot/location"]
    assert flight.epoch is not None
    t = np.array([stamp for _, stamp, _ in places]) * 1e-9 - flight.epoch.unix_s
    gps = flight.series["gps"]
    inside = (gps.t > t[0]) & (gps.t < t[-1])
    metres = 6.37e6 * np.array([1.0, np.cos(gps["lat_rad"][0])])
    own = np.radians(
        [np.interp(gps.t[inside], t, [body[n] for _, _, body in places]) for n in ("latitude", "longitude")]
    )
    apart = np.linalg.norm((own.T - np.column_stack([gps["lat_rad"], gps["lon_rad"]])[inside]) * metres, axis=1)
    assert np.median(apart) < 1.0
    assert apart.max() < 3.0


def test_json_is_the_analysis_and_the_tracks(
    flight: c.Flight, exported: Callable[[str], Path], capsys: Captured
) -> None:
    path = exported("json")
    capsys.readouterr()
    assert main(["analyze", str(DEMO), "--json"]) == 0
    document = json.loads(path.read_text())
    tracks = document.pop("tracks")
    assert document == json.loads(capsys.readouterr().out)
    gyro = tracks["raw_imu"]["columns"]["gyro_x_radps"]
    assert (gyro["unit"], gyro["frame"]) == ("rad/s", "FRD")
    assert gyro["values"] == flight.imu("RAW_IMU").gyro[:, 0].tolist()


@pytest.mark.parametrize("kind", FORMATS)
def test_an_existing_output_stays(kind: str, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "there"
    if FORMATS[kind].is_folder:
        path.mkdir()
    mine = path / "imu.tum" if path.is_dir() else path
    mine.write_text("mine")
    log = DEMO if kind == "kml" else resting(tmp_path / "rest.tlog")  # a map needs to know where on Earth
    command = ["export", str(log), "--format", kind, "-o", str(path)]
    assert main(command) == 2
    assert "--force" in capsys.readouterr().err
    assert mine.read_text() == "mine"
    assert main([*command, "--force"]) == 0
    assert (FORMATS[kind].is_folder and kind != "tum") or mine.read_bytes() != b"mine"
    assert not list(tmp_path.rglob(".*")), "nothing half written is left"


@pytest.mark.parametrize("kind", FORMATS)
def test_a_format_is_documented(kind: str) -> None:
    row = next(
        line for line in (ROOT / "docs" / "export.md").read_text().splitlines() if line.startswith(f"| `{kind}` |")
    )
    assert ("a folder" in row) == FORMATS[kind].is_folder


@pytest.mark.parametrize(
    ("kind", "module"), [("parquet", "pyarrow"), ("mcap", "mcap.writer"), ("rosbag2", "mcap.writer")]
)
def test_without_the_extra_there_is_a_line_to_type(
    kind: str, module: str, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["export", str(DEMO), "--format", kind, "-o", str(tmp_path / "x")]) == 2
    said = capsys.readouterr().err
    assert "[export]'" in said
    assert "Traceback" not in said
    assert not list(tmp_path.glob("x*/*"))


def test_a_place_that_cannot_be_written(capsys: Captured, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for kind, path in (("json", "/no/such/folder/x"), ("csv", "/no/such/folder/x"), ("csv", str(tmp_path / "file"))):
        assert main(["export", str(DEMO), "--format", kind, "-o", path]) == 2
        assert "cannot write" in capsys.readouterr().err


def test_a_log_without_an_attitude_gives_what_it_has(tmp_path: Path, capsys: Captured) -> None:
    log = Writer(tmp_path / "log.tlog")
    for i in range(50):
        log.heartbeat(i)
        log.raw_imu(i, 10 + i)
    path = str(log.close())
    assert main(["export", path, "--format", "csv", "-o", str(tmp_path / "csv")]) == 0
    assert "only what the log has" in capsys.readouterr().err
    assert (tmp_path / "csv" / "raw_imu.csv").exists()
    assert not (tmp_path / "csv" / "drift.csv").exists()
    assert main(["export", path, "--format", "tum", "-o", str(tmp_path / "tum")]) == 2
    assert "no attitude to compare with" in capsys.readouterr().err


def test_in_a_gap_of_the_autopilot_mcap_has_the_imu_alone(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    for i in range(1000):
        log.heartbeat(i / 50)
        log.raw_imu(i / 50, 10 + i / 50)
        if not 400 < i < 600:
            log.attitude(i / 50, 10 + i / 50)
    assert main(["export", str(log.close()), "--format", "mcap", "-o", str(tmp_path / "a.mcap")]) == 0
    found = messages(tmp_path / "a.mcap")
    counts = {topic: len(found[topic]) for topic in ("/imu/pose", "/autopilot/pose", "/error")}
    assert counts["/imu/pose"] > 950
    assert counts["/autopilot/pose"] == counts["/error"] < 850


def test_a_flight_without_position_has_attitudes(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    for i in range(1000):
        log.heartbeat(i / 50)
        log.raw_imu(i / 50, 10 + i / 50)
        log.attitude(i / 50, 10 + i / 50)
    path = str(log.close())
    for kind in FORMATS:
        exit_code = 2 if kind == "kml" else 0  # there is no path for a map
        assert main(["export", path, "--format", kind, "-o", str(tmp_path / kind)]) == exit_code
    assert "no position" in (tmp_path / "tum" / "imu.tum").read_text()
    found = messages(tmp_path / "mcap")
    assert "/imu/location" not in found
    assert found["/error"][0][2].keys() == {"timestamp", "frame_id", "attitude_deg", "attitude"}
    assert "Plot!position" not in json.loads((tmp_path / "foxglove" / "layout.json").read_text())["configById"]
    tracks = json.loads((tmp_path / "json").read_text())["tracks"]
    assert not any("position" in name for name in tracks["reckoning"]["columns"])
    assert all(math.isfinite(v) for v in tracks["reckoning"]["columns"]["attitude_error_north_rad"]["values"])


def test_without_gps_mcap_does_not_say_where_the_best_estimate_was(flight: c.Flight, tmp_path: Path) -> None:
    """Nothing holds its position: metres off, and in no other format."""
    blind = replace(flight, gps=())
    assessed = examine(blind, Settings()).assessment
    assert assessed.best is not None
    write_mcap(tmp_path / "a.mcap", blind, assessed_replay(blind, assessed, 10.0), assessed)
    found = messages(tmp_path / "a.mcap")
    assert {value for _, _, body in found["/best/pose"] for value in body["pose"]["position"].values()} == {0.0}
    assert max(body["position_m"] for _, _, body in found["/error"]) > 0.1


def test_the_best_estimate_lies_on_the_autopilot_whatever_its_positions_count_from(
    flight: c.Flight, tmp_path: Path
) -> None:
    """Its own origin is the first fix: an autopilot that was switched on elsewhere counts from there."""
    assert flight.position is not None
    there = np.array([100.0, 50.0, -8.0])
    moved = replace(flight, position=replace(flight.position, position=flight.position.position + there))
    assessed = examine(moved, Settings()).assessment
    assert assessed.best is not None
    shown = assessed_replay(moved, assessed, 10.0)
    write_mcap(tmp_path / "a.mcap", moved, shown, assessed)
    found = messages(tmp_path / "a.mcap")
    table = c.export.tables(moved, shown, assessed)["best_estimate"]
    tum = np.loadtxt(c.export.write_estimate_tum(tmp_path / "best.tum", moved, assessed.best))
    for start in (
        np.array(list(found["/best/pose"][0][2]["pose"]["position"].values())),
        np.array([table[f"position_{axis}_m"][0] for axis in ("north", "east", "down")]),
        tum[0, 1:4],
        np.array(list(found["/paths"][2][2]["entities"][0]["lines"][0]["points"][0].values())),
    ):
        assert start == pytest.approx(shown.position_ref[0], abs=0.5)
    here, other = (found[f"/{name}/location"][0][2] for name in ("best", "autopilot"))
    assert [here[part] for part in ("latitude", "longitude")] == pytest.approx(
        [other[part] for part in ("latitude", "longitude")], abs=1e-5
    )
