"""The build stage on synthetic drives: nothing of an emergency gets in, everything is accounted for, bytes repeat."""

from __future__ import annotations

import io
import json
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.dataset
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from wheelprint.dataset import build as build_module
from wheelprint.dataset.build import plan_build
from wheelprint.dataset.detectors import propose_events
from wheelprint.dataset.events import Event, read_events, write_events
from wheelprint.dataset.folds import deal_folds
from wheelprint.dataset.lookahead import lookahead_distance
from wheelprint.dataset.segments import features
from wheelprint.dataset.situations import Situation, read_situations, write_situations
from wheelprint.dataset.steering import steering_series
from wheelprint.schemas.config import Situations
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, describe_output, publish_table, read_table, sha256
from wheelprint.schemas.tables import DATASET, SYNCED
from wheelprint.schemas.tasks import Outcome
from wheelprint.schemas.times import iso_utc

Floats = NDArray[np.float64]

PERIOD = 100_000_000
START = 1_795_420_800 * 10**9
WHEELBASE, RATIO, OFFSET = 2.8, 15.0, -4.0
CONFIG = f"[vehicle]\nwheelbase = {WHEELBASE}\nsteering_ratio = {RATIO}\nsteering_offset = {OFFSET}\n"
SAMPLES = 1200
RECORDINGS = {"anna": ("monday", "tuesday"), "Bö b": ("ring", "town")}
STANDS = slice(0, 50)
NAMES = Situations().names
BRAKES = slice(600, 615)
GAP = slice(900, 910)


def three_labels(
    features: Floats, clusters: int | Literal["bic"], maximum: int, seed: int
) -> tuple[NDArray[np.int64], Floats, Floats, list[tuple[int, float]]]:
    """Stand in for the mixture: thirds by average course deviation, or fewer where fewer are allowed."""
    assert seed == 0
    count = min(maximum, 3) if clusters == "bic" else clusters
    place = np.argsort(np.argsort(-features[:, 1], kind="stable"), kind="stable")
    labels = place * count // len(features) + 1
    means = np.array([features[labels == label].mean(axis=0) for label in range(1, count + 1)])
    weights = np.bincount(labels, minlength=count + 1)[1:] / len(features)
    return labels, means, weights, [(k, 100.0 - k) for k in range(1, maximum + 1)]


def single_label(
    features: Floats, clusters: int | Literal["bic"], maximum: int, seed: int
) -> tuple[NDArray[np.int64], Floats, Floats, list[tuple[int, float]]]:
    """Another clustering."""
    assert (clusters, seed) == ("bic", 0)
    return np.ones(len(features), np.int64), features.mean(axis=0, keepdims=True), np.ones(1), [(maximum, 0.0)]


def synthetic_drive(seed: int, start: int) -> dict[str, Floats]:
    """A car that follows a winding road kinematically, stands at first, brakes hard once, and has one gap."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(SAMPLES)
    speed = 14 + 3 * np.sin(0.05 * t + seed)
    speed[STANDS] = 0.3
    bend = np.clip(4 * np.sin(0.25 * t + seed), -3, 3) * (np.sin(0.07 * t) > -0.5)
    heading = seed * 50 + np.cumsum(np.degrees(speed * np.tan(np.radians(bend)) / WHEELBASE) * 0.1)
    acceleration = np.zeros(SAMPLES)
    acceleration[BRAKES] = -8.0
    run = np.repeat([0.0, 1.0], [GAP.start, SAMPLES - GAP.start])
    run[GAP] = np.nan
    course = (heading + 180) % 360 - 180
    return {
        "time": start + np.arange(SAMPLES) * PERIOD,
        "run": run,
        "x": np.cumsum(speed * np.cos(np.radians(heading)) * 0.1) + rng.normal(0, 0.01, SAMPLES),
        "y": np.cumsum(speed * np.sin(np.radians(heading)) * 0.1) + rng.normal(0, 0.01, SAMPLES),
        "course": course,
        "heading": course.copy(),
        "nav_speed": speed,
        "speed": speed * 1.1,
        "nav_yaw_rate": np.degrees(speed * np.tan(np.radians(bend)) / WHEELBASE),
        "nav_longitudinal_acceleration": acceleration,
        "steering_wheel_angle": bend * RATIO + OFFSET + rng.normal(0, 0.5, SAMPLES),
    }  # fmt: skip


def synced_table(signals: dict[str, Floats]) -> pa.Table:
    samples = len(signals["time"])
    columns = []
    for field in SYNCED:
        values = signals.get(field.name, np.full(samples, np.nan))
        kind = field.type if field.name != "time" else pa.int64()
        columns.append(pa.array(values, kind, from_pandas=True, safe=False).cast(field.type))
    return pa.table(columns, schema=SYNCED).replace_schema_metadata({"origin": '{"latitude": 1.5}'})


Change = Callable[[str, str, dict[str, Floats]], None]


def make_project(folder: Path, change: Change = lambda *_: None, config: str = CONFIG) -> Project:
    """Two drivers with two recordings each, converted."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "wheelprint.toml").write_text(config, encoding="utf-8")
    project = Project(folder)
    for driver, names in RECORDINGS.items():
        for number, name in enumerate(names):
            (folder / "raw" / driver / name).mkdir(parents=True, exist_ok=True)
            signals = synthetic_drive(number + len(driver), START + number * 3600 * 10**9)
            change(driver, name, signals)
            path = project.synced_file(driver, name)
            publish_table(path, synced_table(signals))
            entry = {"outputs": [describe_output(project.directory, path)], "fingerprint": "", "problems": []}
            Manifest(project.directory).record("recordings", f"{driver}/{name}", entry)
    return project


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return make_project(tmp_path / "project")


def build(project: Project) -> tuple[dict[str, Outcome | InputError], list[InputError]]:
    """What the command does, without processes."""
    tasks, problems = plan_build(project, three_labels)
    outcomes: dict[str, Outcome | InputError] = {}
    for task in tasks:
        task = pickle.loads(pickle.dumps(task))  # noqa: PLW2901  as on its way to another process
        try:
            outcomes[task.name] = outcome = task.run(**task.arguments)
        except InputError as error:
            outcomes[task.name] = error
            Manifest(project.directory).remove(task.section, task.name)
        else:
            kept = [{"path": p.path, "where": p.where, "reason": p.reason} for p in outcome.problems]
            entry = {**outcome.entry, "fingerprint": task.fingerprint, "problems": kept}
            Manifest(project.directory).record(task.section, task.name, entry)
    return outcomes, problems


def built(project: Project) -> dict[str, dict[str, Any]]:
    """Build what must succeed without a problem, and return the entries."""
    outcomes, problems = build(project)
    assert problems == []
    for outcome in outcomes.values():
        assert isinstance(outcome, Outcome)
        assert outcome.problems == ()
    return dict(Project(project.directory).manifest["dataset"])


def rows(project: Project, driver: str = "anna", name: str = "monday") -> dict[str, Any]:
    table = read_table(project.dataset_file(driver, name))
    return {c: table[c].cast(pa.int64()).to_numpy() if c == "time" else table[c].to_numpy() for c in table.column_names}


def at(row: float) -> int:
    return START + round(row * PERIOD)


def test_events_are_proposed_and_what_they_cover_is_absent(project: Project) -> None:
    entries = built(project)
    events = read_events(project.events_file)
    note = "nav_longitudinal_acceleration -8 m/s² (threshold 5)"
    assert [e for e in events if e.recording == "anna/monday"] == [
        Event("anna/monday", at(0), at(50), "standstill", 0.0, "proposed", "", "below 1 m/s"),
        Event("anna/monday", at(590), at(625), "hard_braking", 1.6, "proposed", "", note),
    ]
    assert len(events) == 8
    expected = [*range(50, 590), *range(625, 900), *range(910, SAMPLES)]
    found = rows(project)
    assert found["time"].tolist() == [at(row) for row in expected]
    assert found["run"].tolist() == [0] * 540 + [1] * 275 + [2] * 290
    for entry in entries.values():
        assert entry["excluded"] == {"gap": 2.0, "hard_braking": 7.0, "standstill": 10.0}
        assert entry["driven_s"] == 221.0
        assert entry["samples"] == sum(output["rows"] for output in entry["outputs"]) == 2210
        assert entry["driven_s"] + sum(entry["excluded"].values()) == 2 * SAMPLES / 10


def test_the_columns_say_what_the_design_says(tmp_path: Path) -> None:
    project = make_project(tmp_path, config=CONFIG + "[segments]\nminimum_duration = 0.0\n")
    entry = built(project)["anna"]
    found = rows(project)
    raw = synthetic_drive(4, START)
    index = (found["time"] - START) // PERIOD
    run = found["run"]
    begins = np.flatnonzero(np.diff(run, prepend=-1))

    inner = np.flatnonzero((np.roll(run, 2) == run) & (np.roll(run, -2) == run))[2:-2]
    for column, source in (("x", "x"), ("y", "y"), ("speed", "nav_speed")):
        mean = sum(raw[source][index[inner] + step] for step in range(-2, 3)) / 5
        np.testing.assert_allclose(found[column][inner], mean, rtol=0, atol=1e-9)
    wheel = sum(raw["steering_wheel_angle"][index[inner] + step] for step in range(-2, 3)) / 5 - OFFSET
    np.testing.assert_allclose(found["steering_wheel_angle"][inner], wheel, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["road_wheel_angle"], found["steering_wheel_angle"] / RATIO, rtol=1e-14)
    np.testing.assert_array_equal(found["course"], found["heading"])
    assert np.abs(found["course"]).max() > 150

    step = (np.diff(found["course"], prepend=math.nan) + 180) % 360 - 180
    step[begins] = math.nan
    np.testing.assert_allclose(found["course_deviation"], step, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(found["course_deviation"]), np.isin(np.arange(len(run)), begins))
    # kinematics: the course turns by v tan(δ) / L
    turning = np.degrees(found["speed"] * np.tan(np.radians(found["road_wheel_angle"])) / WHEELBASE) * 0.1
    assert np.corrcoef(turning[inner], step[inner])[0, 1] > 0.98

    expected = lookahead_distance(
        found["x"], found["y"], found["heading"], found["road_wheel_angle"], run, WHEELBASE, project.config.lookahead
    )
    np.testing.assert_array_equal((found["lookahead"], found["lookahead_spread"]), expected)
    assert np.isnan(found["lookahead"]).mean() < 0.05

    side = np.where(step > 0.05, "left", np.where(step < -0.05, "right", "neutral"))
    side[begins] = side[begins + 1]
    assert found["path_side"].tolist() == side.tolist()
    assert set(side) == {"left", "right", "neutral"}
    segment, label = found["segment"], found["path_label"]
    changes = np.flatnonzero((np.diff(run) != 0) | (side[1:] != side[:-1])) + 1
    assert segment.tolist() == np.cumsum(np.isin(np.arange(len(run)), changes)).tolist()
    firsts = np.flatnonzero(np.diff(segment, prepend=-1))
    previous, own, following = (np.array([int(t.split("-")[i]) for t in found["path_type"]]) for i in range(3))
    np.testing.assert_array_equal(own, label)
    for this, after in pairwise(firsts):
        connected = run[this] == run[after]
        assert following[this] == (label[after] if connected else label[this])
        assert previous[after] == (label[this] if connected else label[after])
    second = rows(project, "anna", "tuesday")
    parts = [features(r["course_deviation"], r["speed"], r["segment"], PERIOD) for r in (found, second)]
    assert entry["segments"] == sum(map(len, parts))
    expected_labels = three_labels(np.concatenate(parts), "bic", 3, 0)[0]
    np.testing.assert_array_equal(label, expected_labels[: len(parts[0])][segment])
    np.testing.assert_array_equal(second["path_label"], expected_labels[len(parts[0]) :][second["segment"]])
    assert [cluster["label"] for cluster in entry["clusters"]] == [1, 2, 3]
    assert sum(cluster["share"] for cluster in entry["clusters"]) == pytest.approx(1)
    deviations = [cluster["average_course_deviation_deg"] for cluster in entry["clusters"]]
    assert deviations == sorted(deviations, reverse=True)
    assert entry["bic"][:2] == [{"clusters": 1, "bic": 99.0}, {"clusters": 2, "bic": 98.0}]
    assert entry["distance_m"] == pytest.approx(14 * 221, rel=0.1)


def test_folds_run_through_the_drivers_recordings_in_the_order_of_time(tmp_path: Path) -> None:
    def tuesday_first(_driver: str, name: str, signals: dict[str, Floats]) -> None:
        if name == "tuesday":
            signals["time"] -= 7200 * 10**9

    project = make_project(tmp_path, tuesday_first)
    entry = built(project)["anna"]
    assert [output["recording"] for output in entry["outputs"]] == ["tuesday", "monday"]
    fold = np.concatenate([rows(project, "anna", name)["fold"] for name in ("tuesday", "monday")])
    np.testing.assert_array_equal(fold, deal_folds(2210, 10, 0))


def test_the_project_reads_what_was_built(project: Project) -> None:
    built(project)
    assert read_table(project.dataset_file("anna", "monday")).schema.remove_metadata() == DATASET.remove_metadata()
    table = Project(project.directory).dataset()
    assert table.column_names == ["driver", "recording", *DATASET.names]
    assert len(table) == 4420
    metadata = read_table(project.dataset_file("anna", "monday")).schema.metadata
    paths = [project.synced_file("anna", name) for name in ("monday", "tuesday")]
    inputs = {path.relative_to(project.directory).as_posix(): sha256(path) for path in paths}
    assert json.loads(metadata[b"inputs"]) == inputs
    assert json.loads(metadata[b"origin"]) == {"latitude": 1.5}
    assert json.loads(metadata[b"parameters"])["steering"] == {"ratio": RATIO, "offset": OFFSET}
    versions = {"wheelprint", "numba", "numpy", "pyarrow", "scipy"}
    assert json.loads(metadata[b"versions"]).keys() == versions
    assert json.loads(metadata[b"versions"])["numpy"] == np.__version__
    assert json.loads(metadata[b"events"])["left_out"] == 4
    expected = ("driver", "recording", "origin", "versions", "parameters", "inputs", "events", "situations")
    assert {key.decode() for key in metadata} == set(expected)
    # the data card beside the tables is in nobody's way
    assert len(pyarrow.dataset.dataset(project.directory / "dataset", partitioning="hive").to_table()) == 4420


def test_same_inputs_same_bytes(tmp_path: Path) -> None:
    first, second = (make_project(tmp_path / name) for name in ("one", "two"))
    entries = built(first), built(second)
    assert entries[0] == entries[1]
    files = sorted(path.relative_to(first.directory) for path in first.directory.rglob("dataset/**/*.parquet"))
    assert len(files) == 4
    cards = sorted(path.relative_to(first.directory) for path in first.directory.rglob("_card.json"))
    assert len(cards) == 2
    for file in (*files, *cards, Path("events.csv"), Path("manifest.json")):
        assert (first.directory / file).read_bytes() == (second.directory / file).read_bytes()


def test_nothing_of_what_is_left_out_gets_in(tmp_path: Path) -> None:
    def vandalise(_driver: str, _name: str, signals: dict[str, Floats]) -> None:
        for name in ("x", "y", "course", "heading", "speed", "steering_wheel_angle"):
            for stretch in (slice(0, 50), slice(590, 625), GAP):
                signals[name][stretch] = 77.0

    # Steering at random looks like skidding, whose padding is wider than that of the braking.
    config = CONFIG + "[events]\nskid = 1000\n"
    clean = make_project(tmp_path / "clean", config=config)
    vandalised = make_project(tmp_path / "vandalised", vandalise, config)
    built(clean), built(vandalised)
    for driver, names in RECORDINGS.items():
        for name in names:
            tables = [read_table(p.dataset_file(driver, name)) for p in (clean, vandalised)]
            assert tables[0].equals(tables[1])


def test_bytes_follow_from_what_is_said_of_the_driver_alone(project: Project) -> None:
    built(project)
    file = project.dataset_file("anna", "monday")
    before = file.read_bytes()
    events = read_events(project.events_file)
    for change in (
        {"decision": "emergency", "decided_by": "Li", "note": "seen"},  # left out as before
        {"decision": "normal", "decided_by": "Li"},
    ):
        write_events(
            project.events_file,
            [replace(e, **change) if e.recording.startswith("Bö b") else e for e in events],  # type: ignore[arg-type]
        )
        built(project)
        assert file.read_bytes() == before
    write_events(project.events_file, [replace(e, decision="emergency", decided_by="Li") for e in events])
    built(project)
    assert file.read_bytes() == before
    write_events(project.events_file, [replace(e, decision="normal") if e.severity else e for e in events])
    built(project)
    digests = [json.loads(pq.read_schema(source).metadata[b"events"]) for source in (io.BytesIO(before), file)]
    assert [digest["left_out"] for digest in digests] == [4, 2]
    assert digests[0]["sha256"] != digests[1]["sha256"]


def test_the_data_card(project: Project) -> None:
    entry = built(project)["anna"]
    (document,) = entry["documents"]
    path = project.data_card_file("anna")
    assert document == describe_output(project.directory, path)
    card = json.loads(path.read_text(encoding="utf-8"))
    assert card["driver"] == "anna"
    assert card["driven_s"] == pytest.approx(221.0)
    assert card["distance_m"] == entry["distance_m"]
    assert card["sampling"] == {"rate_hz": 10.0, "period_s": 0.1}
    assert card["units"]["course_deviation"] == "deg"
    assert card["recordings"][0] == {
        "recording": "monday", "start": iso_utc(at(50)), "stop": iso_utc(at(SAMPLES)), "samples": 1105, "runs": 3,
        "distance_m": pytest.approx(14 * 110.5, rel=0.1),
    }  # fmt: skip

    table = Project(project.directory).dataset("anna").to_pandas()
    slow, *_, unending = card["road"]["speed_m_s"]
    assert (slow["from"], slow["to"], slow["seconds"]) == (0.0, 5.0, 0.0)
    assert (unending["from"], unending["to"]) == (30.0, None)
    quick = next(part for part in card["road"]["speed_m_s"] if part["from"] == 15.0)
    chosen = table["speed"].between(15, 20, inclusive="left")
    assert quick["seconds"] == pytest.approx(chosen.sum() / 10)
    assert quick["distance_m"] == pytest.approx(table["speed"][chosen].sum() / 10)
    radius = table["speed"] * 0.1 / np.radians(table["course_deviation"].abs())
    bends = next(part for part in card["road"]["curvature_1_m"] if part["from"] == 0.005)
    assert bends["seconds"] == pytest.approx(((radius <= 200) & (radius > 50)).sum() / 10)
    unknown = card["road"]["curvature_1_m"][-1]
    assert (unknown["from"], unknown["seconds"]) == (None, pytest.approx(0.6))
    for road in card["road"].values():
        assert math.fsum(part["seconds"] for part in road) == pytest.approx(221.0)

    sides = card["segments"]["by_side"]
    assert sum(part["segments"] for part in sides.values()) == entry["segments"]
    assert sides["left"]["seconds"] == pytest.approx((table["path_side"] == "left").sum() / 10)
    assert card["segments"]["by_label"] == entry["clusters"]
    assert card["excluded"] == [
        {"kind": "gap", "seconds": 2.0, "share": 2 / 240, "undecided_s": 0.0},
        {"kind": "hard_braking", "seconds": 7.0, "share": 7 / 240, "undecided_s": 7.0},
        {"kind": "standstill", "seconds": 10.0, "share": 10 / 240, "undecided_s": 10.0},
    ]
    assert card["folds"]["samples"] == [221] * 10
    assert sorted({name for names in card["folds"]["recordings"] for name in names}) == ["monday", "tuesday"]
    assert card["inputs"] == json.loads(pq.read_schema(project.dataset_file("anna", "monday")).metadata[b"inputs"])

    path.unlink()
    task = next(task for task in plan_build(project, three_labels)[0] if task.name == "anna")
    assert not Manifest(project.directory).is_current("dataset", "anna", task.fingerprint)
    build(project)
    assert path.is_file()
    Manifest(project.directory).remove("dataset", "anna")
    assert not path.exists()


def test_whole_recordings_are_dealt_to_the_folds(tmp_path: Path) -> None:
    by_recording = CONFIG + '[dataset]\nby = "recording"\nfolds = '
    project = make_project(tmp_path / "two", config=by_recording + "2\n")
    built(project)
    folds = [set(rows(project, "anna", name)["fold"].tolist()) for name in ("monday", "tuesday")]
    assert sorted(map(len, folds)) == [1, 1]
    assert folds[0] | folds[1] == {0, 1}

    project = make_project(tmp_path / "three", config=by_recording + "3\n")
    outcomes, problems = build(project)
    assert problems == []
    assert str(outcomes["anna"]) == (
        f"{project.directory}/wheelprint.toml: dataset.folds: driver 'anna': dataset.by = \"recording\" deals whole "
        'recordings to 3 folds, and there are 2 with ordinary driving; write folds = 2 or less, by = "block", or add '
        "recordings"
    )


@pytest.mark.parametrize("smoothing", ["moving average", "zero-phase", "causal"])
def test_a_turned_map_changes_nothing_but_positions_and_directions(tmp_path: Path, smoothing: str) -> None:
    def turned(_driver: str, _name: str, signals: dict[str, Floats]) -> None:
        east, north = signals["x"].copy(), signals["y"].copy()
        signals["x"], signals["y"] = 0.6 * east - 0.8 * north, 0.8 * east + 0.6 * north
        for name in ("course", "heading"):
            signals[name] = (signals[name] + math.degrees(math.atan2(0.8, 0.6)) + 180) % 360 - 180

    config = CONFIG + f'[dataset]\nsmoothing = "{smoothing}"\n'
    here, there = make_project(tmp_path / "a", config=config), make_project(tmp_path / "b", turned, config)
    built(here), built(there)
    for driver, names in RECORDINGS.items():
        for name in names:
            one, other = rows(here, driver, name), rows(there, driver, name)
            for column in ("course_deviation", "speed", "steering_wheel_angle", "lookahead"):
                np.testing.assert_allclose(other[column], one[column], rtol=0, atol=1e-6, err_msg=column)
            for column in ("time", "run", "segment", "path_side", "path_type", "fold"):
                np.testing.assert_array_equal(other[column], one[column], err_msg=column)


def decide(project: Project, kind: str, decision: Literal["emergency", "normal"]) -> None:
    events = read_events(project.events_file)
    write_events(
        project.events_file,
        [replace(e, decision=decision, decided_by="Li") if e.kind == kind else e for e in events],
    )


def test_short_segments_are_merged_and_bends_end_late_where_asked(tmp_path: Path) -> None:
    counts = []
    for number, keys in enumerate(
        ("minimum_duration = 0.0", "minimum_duration = 0.0\nrelease = 0.02", "release = 0.02")
    ):
        project = make_project(tmp_path / str(number), config=f"{CONFIG}[segments]\n{keys}\n")
        entry = built(project)["anna"]
        found = rows(project)
        counts.append(entry["segments"])
        assert (np.bincount(found["segment"]).min() >= 5) == (number == 2)
        between = (np.abs(found["course_deviation"]) > 0.02) & (np.abs(found["course_deviation"]) <= 0.05)
        assert (set(found["path_side"][between]) == {"neutral"}) == (number == 0)
    assert counts[1] > counts[2]


def test_normal_comes_back_and_emergency_stays_out(project: Project) -> None:
    built(project)
    decide(project, "hard_braking", "normal")
    before = project.events_file.read_bytes()
    entry = built(project)["anna"]
    assert project.events_file.read_bytes() == before
    assert entry["excluded"] == {"gap": 2.0, "standstill": 10.0}
    assert entry["undecided"] == {"standstill": 10.0}
    assert rows(project)["run"].tolist() == [0] * 850 + [1] * 290

    decide(project, "hard_braking", "emergency")
    assert built(project)["anna"]["excluded"] == {"gap": 2.0, "hard_braking": 7.0, "standstill": 10.0}


def test_a_decision_made_while_the_build_plans_is_kept(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    built(project)

    def decide_meanwhile(*arguments: Any) -> list[Event]:
        decide(project, "hard_braking", "normal")
        return propose_events(*arguments)

    monkeypatch.setattr(build_module, "propose_events", decide_meanwhile)
    built(project)
    decided = [event.decision for event in read_events(project.events_file) if event.kind == "hard_braking"]
    assert decided
    assert set(decided) == {"normal"}


def test_a_person_may_add_an_event(project: Project) -> None:
    built(project)
    added = Event("anna/monday", at(100.5), at(102), "tram", 0.0, "emergency", "Li", "")
    write_events(project.events_file, [*read_events(project.events_file), added])
    assert built(project)["anna"]["excluded"]["tram"] == 0.1
    assert at(101) not in rows(project)["time"]
    assert at(100) in rows(project)["time"]


def test_only_what_concerns_a_driver_makes_a_task_new(project: Project) -> None:
    def fingerprints() -> dict[str, str]:
        return {task.name: task.fingerprint for task in plan_build(Project(project.directory), three_labels)[0]}

    fingerprints()
    events = read_events(project.events_file)
    write_events(project.events_file, [replace(e, decision="emergency") for e in events])
    first = fingerprints()
    assert fingerprints() == first
    write_events(project.events_file, [replace(e, decision="emergency", note="seen", decided_by="Li") for e in events])
    assert fingerprints() == first
    write_events(
        project.events_file,
        [replace(e, decision="normal") if e.recording.startswith("anna") else replace(e, decision="emergency")
         for e in events],
    )  # fmt: skip
    second = fingerprints()
    assert second["anna"] != first["anna"]
    assert second["Bö b"] == first["Bö b"]
    (project.directory / "wheelprint.toml").write_text(CONFIG + "[events]\npadding = 1.5\n", encoding="utf-8")
    assert fingerprints()["anna"] == second["anna"]
    (project.directory / "wheelprint.toml").write_text(CONFIG + "[dataset]\nsmoothing_window = 1\n", encoding="utf-8")
    third = fingerprints()
    assert set(third.values()).isdisjoint(second.values())
    other = {task.fingerprint for task in plan_build(Project(project.directory), single_label)[0]}
    assert other.isdisjoint(third.values())


def test_the_cars_speed_can_be_taken(tmp_path: Path) -> None:
    project = make_project(tmp_path, config=CONFIG + '[dataset]\nspeed = "can"\nsmoothing_window = 1\n')
    built(project)
    found = rows(project)
    index = (found["time"] - START) // PERIOD
    np.testing.assert_allclose(found["speed"], synthetic_drive(4, START)["speed"][index], rtol=0, atol=1e-12)


def test_missing_values_end_a_run_and_a_single_sample_is_none(tmp_path: Path) -> None:
    def holes(driver: str, name: str, signals: dict[str, Floats]) -> None:
        if (driver, name) == ("anna", "monday"):
            signals["steering_wheel_angle"][[100, 102]] = np.nan
            signals["heading"][200:210] = np.nan
            signals["course"][300] = np.nan

    project = make_project(tmp_path, holes)
    entry = built(project)["anna"]
    assert entry["excluded"] == {"gap": 2.0, "hard_braking": 7.0, "missing": 0.3, "single": 0.1, "standstill": 10.0}
    found = rows(project)
    assert not np.isin([at(100), at(101), at(102), at(300)], found["time"]).any()
    assert found["run"][-1] == 4
    assert np.count_nonzero(np.isnan(found["heading"])) == 10
    assert not np.isnan(found["lookahead"][np.isnan(found["heading"])]).any()


def test_a_recording_without_a_core_column_is_left_out_and_the_rest_goes_on(tmp_path: Path) -> None:
    def unmapped(driver: str, name: str, signals: dict[str, Floats]) -> None:
        if (driver, name) == ("anna", "monday"):
            for column in ("steering_wheel_angle", "x", "y"):
                del signals[column]

    project = make_project(tmp_path, unmapped, CONFIG + "[dataset]\nfolds = 5\n")
    outcomes, _ = build(project)
    outcome = outcomes["anna"]
    assert isinstance(outcome, Outcome)
    assert [str(problem) for problem in outcome.problems] == [
        (
            f"{project.synced_file('anna', 'monday')}: x, y, steering_wheel_angle: nothing but nulls in this "
            "recording, which is left out of the dataset; map the car's signals in wheelprint.toml: [can.signals] "
            'steering_wheel_angle = "Message.Signal"; x, y must come from a navigation log in the recording\'s folder. '
            "`wheelprint inspect FILE` shows what a log holds"
        )
    ]
    assert [output["recording"] for output in outcome.entry["outputs"]] == ["tuesday"]
    assert outcome.entry["excluded"]["missing"] == 120.0
    assert isinstance(outcomes["Bö b"], Outcome)
    assert outcomes["Bö b"].problems == ()


def test_a_recording_of_standstill_alone_is_named(tmp_path: Path) -> None:
    def parked(driver: str, name: str, signals: dict[str, Floats]) -> None:
        if (driver, name) == ("anna", "tuesday"):
            signals["nav_speed"][:] = 0.0

    project = make_project(tmp_path, parked)
    outcome = build(project)[0]["anna"]
    assert isinstance(outcome, Outcome)
    path = project.synced_file("anna", "tuesday")
    assert [str(p) for p in outcome.problems] == [
        f"{path}: no row of it is ordinary driving: gap 1.0 s, standstill 119.0 s"
    ]


def test_a_driver_with_too_little_fails_alone(tmp_path: Path) -> None:
    def parked(driver: str, name: str, signals: dict[str, Floats]) -> None:
        if driver == "anna":
            signals["nav_speed"][300:] = 0.0
        if (driver, name) == ("anna", "tuesday"):
            del signals["x"]

    project = make_project(tmp_path, parked)
    outcomes, problems = build(project)
    assert problems == []
    assert str(outcomes["anna"]) == (
        f"{project.directory}: driver 'anna': 250 samples of ordinary driving, and 600 are needed (60 for each of 10 "
        "folds). Left out: gap 1.0 s, missing 120.0 s, standstill 94.0 s. Recordings without use: "
        f"{project.synced_file('anna', 'tuesday')}: x: nothing but nulls in this recording, which is left out of the "
        "dataset; x must come from a navigation log in the recording's folder. `wheelprint inspect FILE` shows what a "
        "log holds. Add recordings, decide about proposed events (`wheelprint review`), or lower dataset.folds"
    )
    assert isinstance(outcomes["Bö b"], Outcome)
    assert not project.dataset_file("anna", "monday").exists()


def test_what_is_not_converted_is_named_and_left_out(project: Project) -> None:
    (project.directory / "raw/anna/wednesday").mkdir()
    project.synced_file("anna", "tuesday").unlink()
    with project.synced_file("Bö b", "town").open("ab") as file:
        file.write(b"x")
    outcomes, problems = build(project)
    assert [str(problem) for problem in problems] == [
        (
            f"{project.synced_file('Bö b', 'town')}: not the file that `wheelprint convert` wrote, and left out of the "
            "dataset; run it again"
        ),
        (
            f"{project.synced_file('anna', 'tuesday')}: not the file that `wheelprint convert` wrote, and left out of "
            "the dataset; run it again"
        ),
        (
            f"{project.directory}/raw/anna/wednesday: it has no synced table and is left out of the dataset; "
            "`wheelprint convert` says why"
        ),
    ]
    outcome = outcomes["anna"]
    assert isinstance(outcome, Outcome)
    assert [output["recording"] for output in outcome.entry["outputs"]] == ["monday"]


def test_a_damaged_table_and_one_on_another_grid_are_left_out(project: Project) -> None:
    damaged = project.synced_file("anna", "tuesday")
    content = bytearray(damaged.read_bytes())
    content[len(content) // 2] ^= 1
    damaged.write_bytes(content)
    slow = synthetic_drive(3, START)
    slow["time"] = START + (slow["time"] - START) * 2
    publish_table(project.synced_file("Bö b", "ring"), synced_table(slow))
    output = describe_output(project.directory, project.synced_file("Bö b", "ring"))
    Manifest(project.directory).record("recordings", "Bö b/ring", {"outputs": [output]})
    outcomes, problems = build(project)
    assert str(problems[0]) == (
        f"{project.synced_file('Bö b', 'ring')}: time: its rows are 0.2 s apart where sync.rate = 10 Hz asks for 0.1 "
        "s, and it is left out of the dataset; run `wheelprint convert` again"
    )
    assert str(problems[1]).startswith(f"{damaged}: not a whole Parquet file (")
    for driver, name in (("anna", "monday"), ("Bö b", "town")):
        outcome = outcomes[driver]
        assert isinstance(outcome, Outcome)
        assert [output["recording"] for output in outcome.entry["outputs"]] == [name]


def test_a_driver_without_any_converted_recording_loses_the_old_dataset(project: Project) -> None:
    built(project)
    for name in RECORDINGS["anna"]:
        Manifest(project.directory).remove("recordings", f"anna/{name}")
    outcomes, _ = build(project)
    assert str(outcomes["anna"]) == (
        f"{project.directory}: driver 'anna': 0 samples of ordinary driving, and 600 are needed (60 for each of 10 "
        "folds). Add recordings, decide about proposed events (`wheelprint review`), or lower dataset.folds"
    )
    assert not project.dataset_file("anna", "monday").exists()


def test_nothing_converted(tmp_path: Path) -> None:
    (tmp_path / "raw/anna/monday").mkdir(parents=True)
    (tmp_path / "wheelprint.toml").write_text(CONFIG, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        plan_build(Project(tmp_path), three_labels)
    assert str(caught.value) == (
        f"{tmp_path}: no recording is converted; run `wheelprint convert` first ({tmp_path}/raw/anna/monday: it has no "
        "synced table and is left out of the dataset; `wheelprint convert` says why)"
    )


def test_the_column_says_what_situations_csv_says(project: Project) -> None:
    built(project)
    assert {s.decision for s in read_situations(project.situations_file, NAMES)} == {"proposed"}
    tagged = Situation("anna/monday", at(580), at(700), "ring road", "confirmed", "Li", "", "")
    write_situations(project.situations_file, [*read_situations(project.situations_file, NAMES), tagged])
    entry = built(project)["anna"]
    assert tagged in read_situations(project.situations_file, NAMES)
    found = rows(project)
    inside = (found["time"] >= at(580)) & (found["time"] < at(700))
    assert set(found["situation"][inside]) == {"ring road"}
    assert "ring road" not in set(found["situation"][~inside])
    # The 3.5 s of the braking are left out.
    assert entry["situations"]["ring road"] == 8.5
    assert sum(entry["situations"].values()) <= entry["driven_s"]


def test_a_situation_that_the_project_does_not_name_stops_the_build(project: Project) -> None:
    wrong = Situation("anna/monday", at(580), at(700), "rign road", "confirmed", "Li", "", "")
    write_situations(project.situations_file, [wrong])
    with pytest.raises(InputError, match=r"line 2: situation: expected .*; did you mean ring road\?"):
        plan_build(project, three_labels)


def test_events_of_unknown_recordings_are_said(project: Project) -> None:
    stray = [
        Event("anna/munday", at(0), at(50), "tram", 0.0, "emergency", "Li", ""),
        Event("x/y", at(0), at(50), "tram", 0.0, "normal", "Li", ""),
        Event("x/gone", at(0), at(50), "swerve", 1.0, "proposed", "", ""),
    ]
    write_events(project.events_file, stray)
    _, problems = build(project)
    assert [str(problem) for problem in problems] == [
        f"{project.events_file}: anna/munday: the project has no such recording; did you mean anna/monday?",
        f"{project.events_file}: x/y: the project has no such recording; correct or remove its lines",
    ]


def test_fewer_segments_fewer_clusters(tmp_path: Path) -> None:
    def straight(driver: str, _name: str, signals: dict[str, Floats]) -> None:
        if driver == "anna":
            signals["course"][:] = signals["heading"][:] = 0.0

    unmerged = CONFIG + "[segments]\nminimum_duration = 0.0\n"
    project = make_project(tmp_path / "bic", straight, unmerged)
    entries = built(project)
    assert entries["anna"]["segments"] == 6
    assert entries["anna"]["bic"] == []
    assert entries["anna"]["clusters"] == [
        {
            "label": 1, "share": 1.0, "duration_s": pytest.approx(221 / 6), "average_course_deviation_deg": 0.0,
            "maximum_course_deviation_deg": 0.0, "average_speed_m_s": pytest.approx(14, rel=0.1),
        }
    ]  # fmt: skip
    assert set(rows(project)["path_type"]) == {"1-1-1"}
    assert len(entries["Bö b"]["clusters"]) == 3

    def straight_tuesday(_driver: str, name: str, signals: dict[str, Floats]) -> None:
        if name == "tuesday":
            signals["course"][:] = 0.0

    entry = built(make_project(tmp_path / "few", straight_tuesday, unmerged))["anna"]
    assert entry["segments"] in range(20, 60)
    assert [row["clusters"] for row in entry["bic"]] == list(range(1, entry["segments"] // 10 + 1))

    project = make_project(tmp_path / "two", straight, unmerged + "clusters = 2\n")
    outcomes, _ = build(project)
    outcome = outcomes["anna"]
    assert isinstance(outcome, Outcome)
    assert [str(problem) for problem in outcome.problems] == [
        (
            f"{project.directory}/wheelprint.toml: segments.clusters: driver 'anna': 2 clusters were asked for, and 6 "
            'segments give 1; ask for fewer, write "bic", or add recordings'
        )
    ]
    assert isinstance(outcomes["Bö b"], Outcome)
    assert len(outcomes["Bö b"].entry["clusters"]) == 2


def test_another_rate_keeps_the_meaning_of_neutral(tmp_path: Path) -> None:
    def twice_as_fast(_driver: str, _name: str, signals: dict[str, Floats]) -> None:
        signals["time"] = START + (signals["time"] - START) // 2

    as_fast = CONFIG + "[sync]\nrate = 20.0\n"
    segments = "[segments]\nminimum_duration = {}\n"
    project = make_project(tmp_path / "merged", twice_as_fast, as_fast + segments.format(0.4))
    assert built(project)["anna"]["driven_s"] == 108.5
    found = rows(project)
    assert np.bincount(found["segment"]).min() >= 8
    project = make_project(tmp_path / "all", twice_as_fast, as_fast + segments.format(0.0))
    built(project)
    found = rows(project)
    begins = np.diff(found["run"], prepend=-1) != 0
    is_neutral = np.abs(found["course_deviation"]) <= 0.025
    np.testing.assert_array_equal(found["path_side"][~begins] == "neutral", is_neutral[~begins])


def test_what_is_not_given_of_the_steering_is_estimated_and_told(tmp_path: Path) -> None:
    project = make_project(tmp_path, config="[vehicle]\nwheelbase = 2.8\n")
    built(project)
    told = project.manifest["calibration"]
    assert told["steering_ratio"] == pytest.approx(RATIO, rel=0.01)
    assert told["steering_offset_deg"] == pytest.approx(OFFSET, abs=0.2)
    assert 0 < told["steering_ratio_standard_error"] < 0.2
    assert 0 < told["steering_offset_deg_standard_error"] < 0.2
    assert told["estimated"] == ["steering_ratio", "steering_offset"]
    found = rows(project)
    np.testing.assert_allclose(found["road_wheel_angle"], found["steering_wheel_angle"] / told["steering_ratio"])
    (tmp_path / "wheelprint.toml").write_text("[vehicle]\nwheelbase = 2.8\nsteering_ratio = 14.0\n", encoding="utf-8")
    built(Project(tmp_path))
    told = project.manifest["calibration"]
    assert (told["steering_ratio"], told["steering_ratio_standard_error"]) == (14.0, 0.0)
    assert told["estimated"] == ["steering_offset"]


def test_the_steering_is_not_estimated_twice(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    plan_build(project, three_labels)
    monkeypatch.setattr("wheelprint.dataset.steering.estimate_steering", None)
    plan_build(project, three_labels)
    publish_table(path := project.synced_file("anna", "monday"), synced_table(synthetic_drive(9, START)))
    entry = {"outputs": [describe_output(project.directory, path)], "fingerprint": "", "problems": []}
    Manifest(project.directory).record("recordings", "anna/monday", entry)
    with pytest.raises(TypeError):
        plan_build(project, three_labels)


def test_gaps_and_the_ends_of_recordings_are_seen_by_the_calibration() -> None:
    signals = synthetic_drive(1, START)
    signals["yaw_rate"] = signals["nav_yaw_rate"] + 1.0
    signals["nav_yaw_rate"] = np.where(np.arange(SAMPLES) < 20, np.nan, signals["nav_yaw_rate"])
    series = steering_series(synced_table(signals))
    assert series.shape == (3, SAMPLES + 1)
    assert np.isnan(series[:, GAP]).all()
    assert np.isnan(series[:, -1]).all()
    np.testing.assert_array_equal(series[1, :20], signals["yaw_rate"][:20])
    np.testing.assert_array_equal(series[1, 20 : GAP.start], signals["nav_yaw_rate"][20 : GAP.start])
    np.testing.assert_array_equal(series[2, :20], signals["nav_speed"][:20])


def test_a_steering_that_cannot_be_told_is_an_error(tmp_path: Path) -> None:
    def unmapped(_driver: str, _name: str, signals: dict[str, Floats]) -> None:
        del signals["steering_wheel_angle"]

    project = make_project(tmp_path, unmapped, "[vehicle]\nwheelbase = 2.8\nsteering_offset = 1.0\n")
    with pytest.raises(InputError) as caught:
        plan_build(project, three_labels)
    assert str(caught.value) == (
        f"{tmp_path}/wheelprint.toml: vehicle.steering_ratio: no number is given, and none can be estimated: "
        "no recording has any steering_wheel_angle"
    )
    assert len(read_events(project.events_file)) == 8


def test_steering_of_the_wrong_sign_is_said_even_where_numbers_are_given(tmp_path: Path) -> None:
    def reverse(_driver: str, _name: str, signals: dict[str, Floats]) -> None:
        signals["steering_wheel_angle"] *= -1

    _, problems = plan_build(make_project(tmp_path, reverse), three_labels)
    assert len(problems) == 1
    assert str(problems[0]).startswith(
        f"{tmp_path}/wheelprint.toml: vehicle.steering_ratio, vehicle.steering_offset: taken as given, although the "
        "steering wheel angle turns against the yaw rate (correlation -"
    )


def with_references(folder: Path, missing: str, definition: str) -> Project:
    """The synthetic drives, each with its own driven path as reference but for one recording."""
    reference = f'[lookahead]\ndefinition = "{definition}"\nreference = "paths/{{driver}}/{{recording}}.csv"\n'

    def write_reference(driver: str, name: str, signals: dict[str, Floats]) -> None:
        if f"{driver}/{name}" != missing:
            path = folder / "paths" / driver / f"{name}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            lines = [f"{x},{y}" for x, y in zip(signals["x"][60:], signals["y"][60:], strict=True)]
            path.write_text("\n".join(["x,y", *lines, ""]), encoding="utf-8")

    return make_project(folder, write_reference, CONFIG + reference)


@pytest.mark.parametrize("definition", ["paper", "refined"])
def test_reference_paths_are_read_and_accounted_for(tmp_path: Path, definition: str) -> None:
    project = with_references(tmp_path / "project", "anna/tuesday", definition)
    outcomes, problems = build(project)
    assert [(p.path, p.reason.split(";")[0]) for p in problems] == [
        (str(project.directory / "paths/anna/tuesday.csv"), "no such file")
    ]
    outcome = outcomes["anna"]
    assert isinstance(outcome, Outcome)
    facts = outcome.entry["lookahead"]
    assert (facts["definition"], facts["reference"]) == (definition, "paths/{driver}/{recording}.csv")
    monday, tuesday = (read_table(project.dataset_file("anna", name)) for name in ("monday", "tuesday"))
    assert tuesday["lookahead"].null_count == len(tuesday)
    assert monday["lookahead"].null_count < 0.2 * len(monday)
    inputs = json.loads(monday.schema.metadata[b"inputs"])
    assert inputs["paths/anna/monday.csv"] == sha256(project.directory / "paths/anna/monday.csv")
    assert "paths/anna/tuesday.csv" not in json.loads(tuesday.schema.metadata[b"inputs"])

    before = {task.name: task.fingerprint for task in plan_build(project, three_labels)[0]}
    with (project.directory / "paths/anna/monday.csv").open("a", encoding="utf-8") as file:
        file.write("9999,0\n")
    tasks, _ = plan_build(project, three_labels)
    assert [task.name for task in tasks if task.fingerprint != before[task.name]] == ["anna"]
    (anna,) = (task for task in tasks if task.name == "anna")
    torn = [p for p in anna.run(**anna.arguments).problems if p.path.endswith("monday.csv")]
    assert len(torn) == 1
    assert torn[0].reason.endswith("is the path in order and in one piece?")
