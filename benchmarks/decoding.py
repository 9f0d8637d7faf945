"""Logs to Parquet beside other tools, in one run: `python -m benchmarks.decoding [--frames N] [--repeats N] [--long]`.

Every contender turns the same simulated traffic (`bus_traffic`: 40 messages, 347 signals) into Parquet files of
physical values, one for each message, in a process of its own. Tools that take long per frame are measured on two
samples, which shows that a frame costs the same in both; ratios are of CPU seconds per frame. NCOM is compared with a
decoder that unpacks packet by packet, as a program written after OxTS's manual does.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from collections import defaultdict
from itertools import chain, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.bus_traffic import messages, write_logs
from benchmarks.contenders import Result, Work, compare, run_alone

SEED = 1
FRAMES, PACKETS, LONG_FRAMES = 5_000_000, 2_000_000, 50_000_000
SAMPLES = 100_000, 200_000
"""Frames or packets of the slow tools."""
WARM_UP = 20_000
HERE = "benchmarks.decoding"


def wheelprint_log(folder: str, name: str, warm: str) -> Work:
    """Convert a CAN log as `wheelprint convert` does."""
    from wheelprint.ingest.account import Account
    from wheelprint.ingest.can.blf import Blf
    from wheelprint.ingest.can.candump import Candump
    from wheelprint.ingest.can.database import load_database
    from wheelprint.ingest.memory import keep_memory, leave_out_asammdf, leave_out_pandas, leave_out_scipy
    from wheelprint.ingest.signal_files import decode_log

    leave_out_asammdf()
    leave_out_pandas()
    leave_out_scipy()
    database = load_database([str(Path(folder) / "bus.dbc")], Path())
    keep_memory()

    def convert(log: Path) -> Result:
        with TemporaryDirectory(dir=folder) as out:
            account = Account()
            reader = Blf(log) if log.suffix == ".blf" else Candump(log)
            decoded = decode_log(reader, account, database, Path(out), log.name)
            size = sum(file.stat().st_size for file in decoded.files.values())
        assert account.rejected == 0  # noqa: S101 - a benchmark of something else
        return {"frames": decoded.rows.total(), "parquet_mb": size / 1e6}

    convert(Path(warm) / name)
    return lambda: convert(Path(folder) / name)


def python_can_log(folder: str, name: str, frames: int) -> Work:
    """Read with python-can, decode with cantools, collect, and let pandas write Parquet."""
    import can
    import cantools
    import pandas as pd

    database = cantools.database.load_file(Path(folder) / "bus.dbc")
    reader: Any = can.BLFReader if name.endswith(".blf") else can.CanutilsLogReader

    def convert(count: int) -> Result:
        rows: dict[int, list[dict[str, Any]]] = defaultdict(list)
        with reader(str(Path(folder) / name)) as log:
            for frame in islice(log, count):
                values = database.decode_message(frame.arbitration_id, frame.data, decode_choices=False)
                rows[frame.arbitration_id].append({"time": frame.timestamp, "channel": frame.channel, **values})
        with TemporaryDirectory(dir=folder) as out:
            for identifier, values in rows.items():
                table = pd.DataFrame(values)
                table.to_parquet(Path(out) / f"{identifier}.parquet", compression="zstd")
        return {"frames": sum(map(len, rows.values()))}

    convert(1000)
    return lambda: convert(frames)


def asammdf_log(folder: str, warm: str) -> Work:
    """Extract the bus logging of an MF4 file with asammdf, and let pandas write Parquet, group by group."""
    from asammdf import MDF

    def convert(where: str) -> Result:
        frames = 0
        with MDF(Path(where) / "bus.mf4") as log, TemporaryDirectory(dir=folder) as out:
            extracted = log.extract_bus_logging({"CAN": [(str(Path(folder) / "bus.dbc"), 0)]})
            for number, group in enumerate(extracted.iter_groups(time_from_zero=False)):
                frames += len(group)
                group.to_parquet(Path(out) / f"{number}.parquet", compression="zstd")
            extracted.close()
        return {"rows": frames}

    convert(warm)
    return lambda: convert(folder)


def writing(folder: str) -> Work:
    """Write what `wheelprint_log` writes, from memory: the same row groups with the same settings."""
    import pyarrow.parquet as pq

    from wheelprint.ingest.account import Account
    from wheelprint.ingest.can.candump import Candump
    from wheelprint.ingest.can.database import load_database
    from wheelprint.ingest.memory import keep_memory
    from wheelprint.ingest.signal_files import decode_log
    from wheelprint.schemas.store import parquet_writer, publish

    database = load_database([str(Path(folder) / "bus.dbc")], Path())
    tables = []
    with TemporaryDirectory(dir=folder) as made:
        files = decode_log(Candump(Path(folder) / "bus.log"), Account(), database, Path(made), "bus.log").files
        for path in files.values():
            with pq.ParquetFile(path) as file:
                tables.append([file.read_row_group(number) for number in range(file.num_row_groups)])
    keep_memory()

    def write() -> Result:
        with TemporaryDirectory(dir=folder) as out:
            for number, groups in enumerate(tables):
                with publish(Path(out) / f"{number}") as draft, parquet_writer(draft, groups[0].schema) as writer:
                    for group in groups:
                        writer.write_table(group)
        return {"frames": sum(len(group) for groups in tables for group in groups)}

    return write


def wheelprint_ncom(folder: str, warm: str) -> Work:
    """Convert NCOM as `wheelprint convert` does."""
    from wheelprint.ingest.account import Account
    from wheelprint.ingest.memory import keep_memory, leave_out_pandas, leave_out_scipy
    from wheelprint.ingest.navigation import navigation_writer
    from wheelprint.ingest.oxts.ncom import Ncom
    from wheelprint.schemas.store import publish

    leave_out_pandas()
    leave_out_scipy()
    keep_memory()

    def convert(where: str) -> Result:
        account, packets = Account(), 0
        batches = Ncom(Path(where) / "unit.ncom").batches(account)
        begun = next(batches)
        with (
            TemporaryDirectory(dir=folder) as out,
            publish(Path(out) / "navigation") as draft,
            navigation_writer(draft, begun.schema) as writer,
        ):
            for batch in chain((begun,), batches):
                writer.write_batch(batch)
                packets += len(batch)
        assert account.rejected == 0  # noqa: S101 - a benchmark of something else
        return {"packets": packets}

    convert(warm)
    return lambda: convert(folder)


def struct_ncom(folder: str, packets: int) -> Work:
    """Unpack NCOM packet by packet, after OxTS's manual, collect, and let pandas write Parquet."""
    import pandas as pd

    middle = struct.Struct("<ddf")
    epoch = 315_964_800  # 1980-01-06, s since 1970

    def signed(octets: bytes) -> int:
        return int.from_bytes(octets, "little", signed=True)

    def convert(count: int) -> Result:
        rows: list[dict[str, Any]] = []
        minute, leap = None, 18
        with (Path(folder) / "unit.ncom").open("rb") as log:
            while len(rows) < count and len(packet := log.read(72)) == 72:
                if packet[0] != 0xE7 or sum(packet[1:71]) & 0xFF != packet[71]:
                    continue
                channel, content = packet[62], packet[63:71]
                if channel == 0:
                    minute = signed(content[:4])
                elif channel == 16 and content[7] & 1:
                    leap = -(signed(content[7:8]) >> 1)
                latitude, longitude, altitude = middle.unpack_from(packet, 23)
                milliseconds = int.from_bytes(packet[1:3], "little")
                row = {
                    "time": None if minute is None else epoch + 60 * minute + milliseconds / 1000 - leap,
                    "status": packet[21],
                    "latitude": np.degrees(latitude),
                    "longitude": np.degrees(longitude),
                    "altitude": altitude,
                }
                for place, names, unit in (
                    (3, ("ax", "ay", "az"), 1e-4),
                    (12, ("wx", "wy", "wz"), 1e-5),
                    (43, ("north", "east", "down"), 1e-4),
                    (52, ("heading", "pitch", "roll"), 1e-6),
                ):
                    for axis, name in enumerate(names):
                        row[name] = signed(packet[place + 3 * axis : place + 3 * axis + 3]) * unit
                rows.append(row)
        with TemporaryDirectory(dir=folder) as out:
            pd.DataFrame(rows).to_parquet(Path(out) / "unit.parquet", compression="zstd")
        return {"packets": len(rows)}

    convert(1000)
    return lambda: convert(packets)


def first_conversion(folder: str) -> Work:
    """Import, compile and convert a few frames: what the first conversion after an installation takes."""

    def work() -> Result:
        wheelprint_log(folder, "bus.log", folder)
        return {}

    return work


def write_ncom(folder: Path, packets: int) -> None:
    """Write a drive of so many packets at 100 Hz in circles."""
    from wheelprint.ingest.oxts import ncom_writer

    seconds = np.arange(packets) / 100
    heading = seconds / 20
    noise = np.random.default_rng(SEED).normal(0, 0.01, (packets, 3))
    speed, radius = 10.0, 200.0
    ncom_writer.write_ncom(
        folder / "unit.ncom",
        time=1_700_000_000_000_000_000 + np.arange(packets) * 10_000_000,
        latitude=39.9 + radius / 6_378_137 * np.degrees(np.sin(heading)),
        longitude=116.3 + radius / 6_378_137 * np.degrees(1 - np.cos(heading)),
        altitude=45.0 + noise[:, 0],
        velocity=np.stack([speed * np.cos(heading), speed * np.sin(heading), 0 * heading], axis=1) + noise,
        orientation=np.stack([heading, 0 * heading, 0 * heading], axis=1) + noise / 10,
        acceleration=np.array([0.0, speed * speed / radius, -9.81]) + noise,
        angular_rate=np.array([0.0, 0.0, 0.05]) + noise / 10,
    )


def per_cpu_second(result: Result) -> float:
    """Return frames or packets per CPU second."""
    return float((result["frames"] if "frames" in result else result["packets"]) / result["cpu_s"])


def run(
    *,
    frames: int = FRAMES,
    packets: int = PACKETS,
    samples: tuple[int, ...] = SAMPLES,
    repeats: int = 5,
    long_frames: int = 0,
    compilation: bool = True,
    peers: tuple[str, ...] = ("candump", "blf", "asammdf", "writing", "ncom"),
) -> Result:
    """Measure and return ratios and figures.

    Args:
        frames: Of the traffic.
        packets: Of the NCOM log.
        samples: Frames or packets that the tools get that take long.
        repeats: Runs of each contender.
        long_frames: Frames of a second log for peak memory; 0: none.
        compilation: Measure what the first conversion takes, too.
        peers: What to measure beside Wheelprint.
    """
    with TemporaryDirectory(prefix="wheelprint-decoding-") as name:
        folder, warm = Path(name), Path(name) / "warm"
        warm.mkdir()
        kinds = ("log", *(["blf"] if "blf" in peers else []), *(["mf4"] if "asammdf" in peers else []))
        for place, size in ((warm, WARM_UP), (folder, frames)):
            write_logs(place, SEED, size, kinds)
        contenders: dict[str, tuple[str, str, tuple[Any, ...]]] = {
            "wheelprint candump": (HERE, "wheelprint_log", (folder, "bus.log", warm))
        }
        for size in samples if "candump" in peers else ():
            contenders[f"python-can candump {size}"] = (HERE, "python_can_log", (folder, "bus.log", size))
        if "writing" in peers:
            contenders["writing alone"] = (HERE, "writing", (folder,))
        if "asammdf" in peers:
            contenders["asammdf mf4"] = (HERE, "asammdf_log", (folder, warm))
        if "blf" in peers:
            contenders["wheelprint blf"] = (HERE, "wheelprint_log", (folder, "bus.blf", warm))
            for size in samples:
                contenders[f"python-can blf {size}"] = (HERE, "python_can_log", (folder, "bus.blf", size))
        if "ncom" in peers:
            write_ncom(folder, packets)
            write_ncom(warm, WARM_UP)
            contenders["wheelprint ncom"] = (HERE, "wheelprint_ncom", (folder, warm))
            for size in samples:
                contenders[f"by packet ncom {size}"] = (HERE, "struct_ncom", (folder, size))
        results = compare(contenders, repeats)
        for result in results.values():
            result.setdefault("frames" if "packets" not in result else "packets", frames)
            result["per_cpu_s"] = per_cpu_second(result)
        first: Result = {}
        if compilation:
            with TemporaryDirectory() as cache:
                first = run_alone((HERE, "first_conversion", (warm,)), {"NUMBA_CACHE_DIR": cache})
        if long_frames:
            (folder / "bus.log").unlink()
            write_logs(folder, SEED, long_frames, ("log",))
            long = run_alone((HERE, "wheelprint_log", (folder, "bus.log", warm)))
            results["wheelprint candump, long"] = long | {"per_cpu_s": per_cpu_second(long)}
    return {
        "traffic": {
            "messages": len(messages(SEED)),
            "signals": sum(len(message.fields) for message in messages(SEED)),
            "frames": frames,
            "packets": packets if "ncom" in peers else 0,
        },
        "repeats": repeats,
        "ratios": ratios(results, samples),
        "first_conversion_cpu_s": first.get("cpu_s", 0.0),
        "contenders": results,
    }


def ratios(results: dict[str, Result], samples: tuple[int, ...]) -> dict[str, float]:
    """Return the ratios of CPU seconds per frame, and how much a slow tool's frame differs between its two samples."""
    speed = {name: result["per_cpu_s"] for name, result in results.items()}
    small, large = min(samples), max(samples)
    found: dict[str, float] = {}
    for ratio, ours, peer in (
        ("candump against python-can + cantools + pandas", "wheelprint candump", f"python-can candump {large}"),
        ("candump against asammdf", "wheelprint candump", "asammdf mf4"),
        ("BLF against python-can + cantools + pandas", "wheelprint blf", f"python-can blf {large}"),
        ("NCOM against packet by packet", "wheelprint ncom", f"by packet ncom {large}"),
    ):
        if ours in speed and peer in speed:
            found[ratio] = speed[ours] / speed[peer]
    if "writing alone" in speed:
        found["candump to Parquet over writing alone"] = speed["writing alone"] / speed["wheelprint candump"]
    for name in ("python-can candump", "python-can blf", "by packet ncom"):
        if f"{name} {large}" in speed and small < large:
            found[f"{name}: a frame of {large} over one of {small}"] = (
                speed[f"{name} {small}"] / speed[f"{name} {large}"]
            )
    return found


def main() -> int:
    """Measure, print ratios and figures, and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--packets", type=int, default=PACKETS)
    parser.add_argument("--samples", type=int, nargs="+", default=SAMPLES)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--peers", nargs="*", default=["candump", "blf", "asammdf", "writing", "ncom"])
    parser.add_argument("--long", action="store_true", help=f"peak memory at {LONG_FRAMES} frames, too")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    results = run(
        frames=chosen.frames,
        packets=chosen.packets,
        samples=tuple(chosen.samples),
        repeats=chosen.repeats,
        long_frames=LONG_FRAMES if chosen.long else 0,
        peers=tuple(chosen.peers),
    )
    for name, ratio in results["ratios"].items():
        print(f"{ratio:7.2f} ×  {name}")
    for name, figures in results["contenders"].items():
        speed, wall, memory = figures["per_cpu_s"] / 1e6, figures["wall_s"], figures["peak_mb"]
        print(f"{speed:7.3f} M/CPU s {wall:7.1f} s wall {memory:6.0f} MB  {name}")
    print(f"{results['first_conversion_cpu_s']:7.1f} CPU s the first conversion, with compilation")
    if chosen.json:
        chosen.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
