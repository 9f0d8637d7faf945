"""The MCAP for viewers, read back with the mcap package's own reader."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from mcap.reader import make_reader

from wheelprint.report.viewer import export_mcap
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.signals import CAN_SIGNALS, NAV_SIGNALS

DRIVER, RECORDING = "王小明", "环路 1"


@pytest.fixture(scope="module")
def file(project: Project, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "recording.mcap"
    export_mcap(project, DRIVER, RECORDING, path)
    return path


def read(path: Path) -> tuple[dict[str, list[tuple[int, dict[str, Any]]]], dict[str, dict[str, Any]], list[int]]:
    """Messages and schemas by topic, and all times in the order of the file."""
    messages: dict[str, list[tuple[int, dict[str, Any]]]] = defaultdict(list)
    schemas: dict[str, dict[str, Any]] = {}
    times = []
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False):
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            schemas[channel.topic] = json.loads(schema.data)
            assert schemas[channel.topic]["title"] == schema.name
            messages[channel.topic].append((message.log_time, json.loads(message.data)))
            times.append(message.log_time)
    return messages, schemas, times


def test_every_position_is_there_at_its_time(project: Project, file: Path) -> None:
    messages, schemas, _ = read(file)
    synced = project.synced(DRIVER)
    synced = synced.filter(pa.compute.equal(synced["recording"], RECORDING))
    positioned = synced.filter(synced["latitude"].is_valid())
    fixes = messages["/position"]
    assert schemas["/position"]["title"] == "foxglove.LocationFix"
    assert [time for time, _ in fixes] == positioned["time"].cast(pa.int64()).to_pylist()
    assert [fix["latitude"] for _, fix in fixes] == positioned["latitude"].to_pylist()
    assert [fix["longitude"] for _, fix in fixes] == positioned["longitude"].to_pylist()
    time, first = fixes[0]
    assert first == {
        "timestamp": {"sec": time // 10**9, "nsec": time % 10**9},
        "frame_id": "navigation",
        "latitude": positioned["latitude"][0].as_py(),
        "longitude": positioned["longitude"][0].as_py(),
        "altitude": 50.0,
        "position_covariance": [0.0004, 0, 0, 0, 0.0004, 0, 0, 0, 0.0004],
        "position_covariance_type": 1,
    }


@pytest.mark.parametrize(("topic", "names"), [("/car", CAN_SIGNALS), ("/navigation", NAV_SIGNALS)])
def test_signals_come_back_and_nulls_have_no_field(
    project: Project, file: Path, topic: str, names: tuple[str, ...]
) -> None:
    messages, schemas, _ = read(file)
    synced = project.synced(DRIVER)
    synced = synced.filter(pa.compute.equal(synced["recording"], RECORDING)).select(names)
    expected = [{k: v for k, v in row.items() if v is not None} for row in synced.to_pylist()]
    assert [row for _, row in messages[topic]] == [row for row in expected if row]
    assert len(messages[topic]) == {"/car": 1200, "/navigation": 1180}[topic], "the gap of 2 s has no navigation"
    assert list(schemas[topic]["properties"]) == list(names)


def test_a_schema_says_what_a_signal_is_and_its_unit(file: Path) -> None:
    _, schemas, _ = read(file)
    assert schemas["/car"]["properties"]["speed"] == {
        "type": "number",
        "description": "vehicle speed measured by the car, m/s",
    }
    assert schemas["/dataset"]["properties"]["path_type"]["type"] == "string"


def test_the_dataset_and_the_events_are_there(project: Project, file: Path) -> None:
    messages, _, _ = read(file)
    dataset = project.dataset(DRIVER)
    dataset = dataset.filter(pa.compute.equal(dataset["recording"], RECORDING))
    assert [row["path_label"] for _, row in messages["/dataset"]] == dataset["path_label"].to_pylist()
    assert [(log["level"], log["message"]) for _, log in messages["/events"]] == [
        (3, "swerve, 2.0 s, severity 1.05: proposed"),
        (3, "hard_braking, 3.0 s, severity 1.31: emergency"),
    ]


def test_messages_are_in_the_order_of_time(file: Path) -> None:
    _, _, times = read(file)
    assert times == sorted(times)


def test_the_same_project_gives_the_same_bytes(project: Project, file: Path, tmp_path: Path) -> None:
    count = export_mcap(project, DRIVER, RECORDING, tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == file.read_bytes()
    assert count == len(read(file)[2])


def test_the_file_says_whose_recording_it_is(file: Path) -> None:
    with file.open("rb") as stream:
        (record,) = make_reader(stream).iter_metadata()
    assert record.name == "wheelprint"
    assert (record.metadata["driver"], record.metadata["recording"]) == (DRIVER, RECORDING)
    assert record.metadata["vehicle"] == "Test <Tang>"
    assert json.loads(record.metadata["clock"])["drift_ppm"] == 12.5


def test_a_recording_that_is_not_converted_is_an_input_error(bare_project: Project, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        export_mcap(bare_project, "anna", "ring", tmp_path / "no.mcap")
    assert str(caught.value) == (
        f"{bare_project.directory}: recording 'anna/ring' has no synced table; run `wheelprint convert` first"
    )
    assert not (tmp_path / "no.mcap").exists()
