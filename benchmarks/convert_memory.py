"""How much memory `wheelprint convert` takes of a long candump: `python -m benchmarks.convert_memory [GB...]`.

For each size in GB a recording is written into a temporary folder: forty messages of four signals at 100 Hz, and with
`--nav` so many hours of NCOM at 100 Hz beside them. Then the command converts it in a process of its own. The memory is
the most that it and all that it started had at once (resident, looked at every 50 ms; what they share counts for each).

It ends 1 where that is 600 MB or more.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

import numpy as np
import psutil  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from benchmarks.build_ten_hours import watch
from wheelprint.ingest.can.candump_writer import write_candump
from wheelprint.ingest.can.frames import FrameBatch
from wheelprint.ingest.oxts.ncom_writer import write_ncom
from wheelprint.schemas.project import Project

MOST_BYTES = 600_000_000
MESSAGES, RATE = 40, 100.0
BYTES_PER_FRAME = 47
START = 1_700_000_000_000_000_000
CHUNK_S = 100
SAMPLE = np.dtype([("speed", "<i2"), ("yaw_rate", "<i2"), ("angle", "<i2"), ("noise", "<i2")])

DBC = 'VERSION ""\n\nBU_: CAR\n\n' + "\n".join(
    f"BO_ {256 + message} M{message}: 8 CAR\n"
    + "".join(
        f' SG_ {name} : {16 * place}|16@1- ({scale},0) [0|0] "{unit}" CAR\n'
        for place, (name, scale, unit) in enumerate(
            [("SPEED", 0.005, "m/s"), ("YAW_RATE", 0.01, "deg/s"), ("ANGLE", 0.1, "deg"), ("NOISE", 1, "")]
        )
    )
    for message in range(MESSAGES)
)
PROJECT = """\
[vehicle]
name = "Forty messages"
wheelbase = 2.8
steering_ratio = 16.0
steering_offset = 0.0

[can]
database = ["car.dbc"]

[can.signals]
speed = "M0.SPEED"
yaw_rate = "M1.YAW_RATE"
steering_wheel_angle = "M2.ANGLE"
"""

Floats = NDArray[np.float64]


def motion(elapsed: Floats) -> tuple[Floats, Floats]:
    """Return speed, m/s, and yaw rate, deg/s, of a drive that never repeats itself."""
    speed = 15 + 5 * np.sin(elapsed / 17) + 3 * np.sin(elapsed / 5.3) + 2 * np.sin(elapsed / 143)
    return speed, 6 * np.sin(elapsed / 7.7) + 4 * np.sin(elapsed / 3.1) + 2 * np.sin(elapsed / 61)


def frames(size: int) -> Iterator[FrameBatch]:
    """Yield frames of about so many bytes of candump."""
    per_chunk = round(CHUNK_S * RATE) * MESSAGES
    noise = np.random.default_rng(1)
    for first in range(0, size // BYTES_PER_FRAME, per_chunk):
        number = first + np.arange(per_chunk)
        elapsed = number / (RATE * MESSAGES)
        payload = np.zeros(per_chunk, SAMPLE)
        speed, yaw_rate = motion(elapsed)
        payload["speed"], payload["yaw_rate"] = np.rint(speed / 0.005), np.rint(yaw_rate / 0.01)
        payload["angle"] = np.rint(16 * np.degrees(2.8 * np.radians(yaw_rate) / speed) / 0.1)
        payload["noise"] = noise.integers(-3000, 3000, per_chunk)
        yield FrameBatch(
            time=START + np.rint(elapsed * 1e6).astype(np.int64) * 1000,
            channel=np.zeros(per_chunk, np.int16),
            channels=("can0",),
            id=(256 + number % MESSAGES).astype(np.uint32),
            extended=np.zeros(per_chunk, bool),
            fd=np.zeros(per_chunk, bool),
            kind=np.zeros(per_chunk, np.uint8),
            length=np.full(per_chunk, 8, np.uint8),
            data=payload.view(np.uint8).reshape(-1, 8),
        )


def write_navigation(path: Path, hours: float) -> None:
    """Write the same drive as the unit saw it, 0.3 s earlier on its clock."""
    elapsed = np.arange(round(hours * 3600 * RATE)) / RATE
    speed, yaw_rate = motion(elapsed + 0.3)
    heading = np.cumsum(np.radians(yaw_rate)) / RATE
    north, east = speed * np.cos(heading), speed * np.sin(heading)
    still = np.zeros(len(elapsed))
    write_ncom(
        path,
        time=START + np.rint(elapsed * 1e3).astype(np.int64) * 1_000_000,
        latitude=48 + np.cumsum(north) / RATE / 111_000,
        longitude=11 + np.cumsum(east) / RATE / 74_000,
        altitude=500.0,
        velocity=np.column_stack([north, east, still]),
        orientation=np.column_stack([np.mod(heading, 2 * np.pi), still, still]),
        acceleration=np.column_stack([still, still, np.full(len(elapsed), -9.81)]),
        angular_rate=np.column_stack([still, still, np.radians(yaw_rate)]),
    )


def measure(gigabytes: float, hours: float, folder: Path) -> int:
    """Write a recording, convert it, print what that took, and return the most memory, bytes."""
    recording = folder / "raw" / "driver" / "drive"
    recording.mkdir(parents=True)
    (folder / "car.dbc").write_text(DBC, encoding="ascii")
    (folder / "wheelprint.toml").write_text(PROJECT, encoding="ascii")
    log = recording / "can.log"
    count = write_candump(log, frames(round(gigabytes * 1e9)))
    if hours:
        write_navigation(recording / "nav.ncom", hours)
    command = [sys.executable, "-m", "wheelprint", "convert", "--project", str(folder), "--workers", "1", "--json"]
    begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    with TemporaryFile("w+") as said:
        child = psutil.Popen(command, stdout=said, stderr=said)
        memory = watch(child)
        if child.returncode not in (0, 3):
            said.seek(0)
            raise SystemExit(said.read())
    wall, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    (entry,) = Project(folder).manifest["recordings"].values()
    decoded = sum(file.get("decoded", 0) for file in entry["inputs"])
    clock = entry["clock"]
    told = f"clock {clock['offset_s']:.3f} s" if clock["applied"] else f"clock not applied: {clock['reason']}"
    print(
        f"{log.stat().st_size / 1e9:6.2f} GB {count / RATE / MESSAGES / 3600:6.2f} h {hours:6.2f} h "
        f"{memory / 1e6:7.0f} MB {wall:6.1f} s {cpu:6.1f} s {os.getloadavg()[0]:5.1f}   {decoded} decoded, {told}",
        flush=True,
    )
    return memory if decoded == count else MOST_BYTES


def main() -> int:
    """Measure each size, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gigabytes", type=float, nargs="*", default=[0.5, 1.0, 2.0, 4.0])
    parser.add_argument("--nav", type=float, default=0.0, help="hours of NCOM beside each candump")
    parser.add_argument("--folder", type=Path, help="where the temporary folders are made")
    arguments = parser.parse_args()
    most = 0
    print("   candump     CAN      NCOM     memory     wall      CPU  load")
    for gigabytes in arguments.gigabytes:
        with TemporaryDirectory(dir=arguments.folder) as folder:
            most = max(most, measure(gigabytes, arguments.nav, Path(folder)))
    print(f"under {MOST_BYTES / 1e6:.0f} MB: {'holds' if most < MOST_BYTES else 'DOES NOT HOLD'}")
    return int(most >= MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())
