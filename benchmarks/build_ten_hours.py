"""How long `wheelprint build` takes, and how much memory: `python benchmarks/build_ten_hours.py [--hours 10]`.

Four drivers with recordings of a quarter of an hour each. One recording per driver is simulated; the others are the
same drive on other days with other noise of the sensors. They are written as `convert` would have left them: synced
tables, and the manifest that confirms them. Then the command runs, and what it took is asked of the system: wall time,
CPU time of it and its workers, and the most memory that all its processes had at once (resident, looked at every 50 ms;
what they share counts for each of them).

It ends 1 where ten hours take 60 s or more, or 1 GB or more. Other work on the machine lengthens the wall time; the CPU
time says what it would be without.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import psutil  # type: ignore[import-untyped]  # it ships no types
import pyarrow as pa
from numpy.typing import NDArray

from wheelprint.modeling.simulation.campaign import FASTEST, Campaign, draw_campaign, project_file
from wheelprint.modeling.simulation.driver import RATE, coloured_noise, drive, intend
from wheelprint.modeling.simulation.road import generate_road
from wheelprint.modeling.simulation.truth import Origin, truth_table
from wheelprint.schemas.angles import wrap_degrees
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, describe_output, publish_json, publish_table, publish_text
from wheelprint.schemas.tables import SYNCED

LONGEST_S, MOST_BYTES = 60.0, 1_000_000_000
DRIVERS, MINUTES, STEP = 4, 15.0, RATE // 10
DAY = 86_400 * 10**9
ORIGIN = Origin(39.9, 116.3, 45.0)

Floats = NDArray[np.float64]


def drive_once(campaign: Campaign, index: int) -> pa.Table:
    """Return the truth of one trip at 10 Hz."""
    trip = campaign.trips[index]
    on_road, at_wheel = np.random.default_rng([campaign.seed, index]).spawn(2)
    duration = 60 * trip.minutes
    while True:
        road = generate_road(on_road, FASTEST * duration)
        if (intentions := intend(on_road, road, trip.driver, trip.emergencies, duration)) is not None:
            motion = drive(at_wheel, road, campaign.car, trip.driver, intentions, duration)
            return truth_table(motion, road, campaign.car, trip.start, ORIGIN)[::STEP]


def synced_table(truth: pa.Table, campaign: Campaign, day: int, noise: np.random.Generator) -> pa.Table:
    """Return what `convert` would make of a drive some days later, with the noise of the sensors."""
    sensors, car, samples = campaign.sensors, campaign.car, len(truth)
    true = {name: truth[name].to_numpy(zero_copy_only=False) for name in truth.column_names if name != "road"}

    def white(name: str, deviation: float, bias: float = 0.0) -> Floats:
        return np.asarray(true[name] + bias + noise.normal(0, deviation, samples), np.float64)

    def slow(name: str, deviation: float, memory: float) -> Floats:
        return np.asarray(true[name] + coloured_noise(noise, samples, deviation, memory), np.float64)

    columns: dict[str, NDArray[np.float64] | NDArray[np.int64]] = {
        "time": truth["time"].cast(pa.int64()).to_numpy() + day * DAY,
        "run": np.zeros(samples, np.int64),
        "steering_wheel_angle": white("steering_wheel_angle", sensors.steering_wheel_angle, car.steering_offset),
        "steering_wheel_speed": white("steering_wheel_speed", 0.0),
        "speed": np.maximum(white("speed", sensors.speed), 0.0),
        "accelerator_pedal": white("accelerator_pedal", 0.0),
        "brake_pressure": white("brake_pressure", sensors.brake_pressure),
        "yaw_rate": white("yaw_rate", sensors.yaw_rate, sensors.yaw_rate_bias),
        "longitudinal_acceleration": white("longitudinal_acceleration", sensors.acceleration),
        "lateral_acceleration": white("lateral_acceleration", sensors.acceleration),
        "gear": np.asarray(true["gear"], np.int64),
        "latitude": white("latitude", 0.0),
        "longitude": white("longitude", 0.0),
        "altitude": white("altitude", 0.0),
        "x": slow("x", sensors.position, 30.0),
        "y": slow("y", sensors.position, 30.0),
        "course": wrap_degrees(slow("course", sensors.attitude, 5.0)),
        "heading": wrap_degrees(slow("heading", sensors.attitude, 5.0)),
        "nav_speed": np.abs(slow("speed", sensors.velocity, 0.5)),
        "nav_yaw_rate": white("yaw_rate", sensors.nav_yaw_rate),
        "nav_longitudinal_acceleration": white("longitudinal_acceleration", sensors.nav_acceleration),
        "nav_lateral_acceleration": white("lateral_acceleration", sensors.nav_acceleration),
        "position_accuracy": np.full(samples, 0.02),
        "nav_status": np.full(samples, 4),
    }
    arrays = [
        pa.array(columns[f.name], pa.int64() if f.name == "time" else f.type).cast(f.type)
        if f.name in columns
        else pa.nulls(samples, f.type)
        for f in SYNCED
    ]
    return pa.table(arrays, SYNCED.with_metadata({"origin": json.dumps(asdict(ORIGIN))}))


def write_project(directory: Path, hours: float, seed: int) -> int:
    """Write a project that is converted; return its number of rows."""
    campaign = draw_campaign(seed, DRIVERS, 1, MINUTES)
    publish_text(directory / "wheelprint.toml", project_file(campaign.car))
    project = Project(directory)
    entries, rows = {}, 0
    for index, trip in enumerate(campaign.trips):
        truth = drive_once(campaign, index)
        for day in range(round(hours * 60 / MINUTES / DRIVERS)):
            name = f"drive{day + 1:03d}"
            (directory / "raw" / trip.driver.name / name).mkdir(parents=True)
            table = synced_table(truth, campaign, day, np.random.default_rng([seed, index, day]))
            path = project.synced_file(trip.driver.name, name)
            publish_table(path, table)
            output = describe_output(project.directory, path, rows=len(table), runs=1, rows_in_runs=len(table))
            entries[f"{trip.driver.name}/{name}"] = {"outputs": [output], "fingerprint": "", "problems": []}
            rows += len(table)
    publish_json(Manifest(project.directory).path, {"recordings": entries})
    return rows


def watch(child: psutil.Popen) -> int:
    """Wait for a process; return the most bytes that it and its descendants had at once."""
    most = 0
    while child.poll() is None:
        total = 0
        with contextlib.suppress(psutil.NoSuchProcess):
            for process in (child, *child.children(recursive=True)):
                with contextlib.suppress(psutil.NoSuchProcess):
                    total += process.memory_info().rss
        most = max(most, total)
        time.sleep(0.05)
    return most


def run(hours: float = 10.0, seed: int = 1, workers: int = 0, folder: Path | None = None) -> dict[str, float]:
    """Measure `wheelprint build`.

    Args:
        hours: Of driving.
        seed: Of the campaign.
        workers: As of the command; 0: one for each core.
        folder: An empty one to work in, kept; None: a temporary one.

    Returns:
        `rows`, `hours`, `drivers`, `wall_s`, `cpu_s` and `memory_mb`, of the process and its descendants.

    Raises:
        RuntimeError: The command failed.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = (folder or Path(temporary)).resolve()
        rows = write_project(folder, hours, seed)
        command = [sys.executable, "-m", "wheelprint", "build", "--project", str(folder), "--json"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.monotonic()
        with tempfile.TemporaryFile("w+") as said:
            child = psutil.Popen([*command, "--workers", str(workers)], stdout=said, stderr=said)
            memory = watch(child)
            wall = time.monotonic() - begin
            used = resource.getrusage(resource.RUSAGE_CHILDREN)
            if child.returncode not in (0, 3):
                said.seek(0)
                raise RuntimeError(said.read())
        built = Project(folder).manifest["dataset"]
    return {
        "rows": rows,
        "hours": rows / 36_000,
        "drivers": len(built),
        "wall_s": wall,
        "cpu_s": used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime,
        "memory_mb": memory / 1e6,
    }


def main() -> int:
    """Measure, print, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=0, help="as of the command; 0: one for each core")
    parser.add_argument("--folder", type=Path, help="an empty one to work in, kept; default: a temporary one")
    chosen = parser.parse_args()
    found = run(chosen.hours, chosen.seed, chosen.workers, chosen.folder)
    workers = chosen.workers or "one for each core"
    print(f"{found['rows']} rows, {found['hours']:.2f} h, of {found['drivers']} drivers; workers: {workers}")
    wall, memory = found["wall_s"], found["memory_mb"]
    print(f"wall {wall:.1f} s, CPU {found['cpu_s']:.1f} s, memory {memory:.0f} MB; load {os.getloadavg()[0]:.1f}")
    holds = wall < LONGEST_S and 1e6 * memory < MOST_BYTES
    print(f"under {LONGEST_S:g} s and {MOST_BYTES / 1e9:g} GB: {'holds' if holds else 'DOES NOT HOLD'}")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
