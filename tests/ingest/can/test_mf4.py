"""MF4 against python-can's writer, and against records written field by field."""

from __future__ import annotations

import gzip
import subprocess
import sys
from ast import literal_eval
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import can
import numpy as np
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.can import mf4
from wheelprint.ingest.can.mf4 import Mf4
from wheelprint.schemas.errors import InputError

needs_asammdf = pytest.mark.skipif(find_spec("asammdf") is None, reason="asammdf is not installed (the extra mf4)")
START = 1_600_000_000_000_000_000


def read(path: Path) -> tuple[pa.Table, Account]:
    account = Account()
    batches = list(Mf4(path).batches(account))
    for batch in batches:
        assert len(batch) <= 1 << 18
    return pa.Table.from_batches([batch.to_arrow() for batch in batches]), account


def write(
    path: Path, *, compression: int = 0, records: int = 500, kinds: tuple[str, ...] = ("Data",), spoil: bool = False
) -> list[dict[str, Any]]:
    """Write groups of frames with whole ns in the time channel; return what they hold, in order of time."""
    from asammdf import MDF, Signal, Source
    from asammdf.blocks import v4_constants as v4c

    rng = np.random.default_rng(1)
    log = MDF(version="4.11")
    log.start_time = datetime.fromtimestamp(START // 10**9, UTC)
    rows: list[dict[str, Any]] = []
    for number, kind in enumerate(kinds):
        time = np.sort(rng.integers(0, 10**11, records)) * 10
        fields: list[tuple[str, np.ndarray, Any]] = [
            ("BusChannel", rng.integers(1, 3, records), np.dtype("u1")),
            ("ID", rng.integers(0, 0x7FF, records), np.dtype("<u4")),
            ("IDE", rng.integers(0, 2, records), np.dtype("u1")),
            ("DLC", np.full(records, 8), np.dtype("u1")),
            ("DataLength", rng.integers(0, 9, records), np.dtype("u1")),
            ("EDL", rng.integers(0, 2, records), np.dtype("u1")),
        ]
        if spoil:
            fields[1:3] = [("ID", np.array([0x800, 1, 2, 3]), np.dtype("<u4")), ("IDE", np.zeros(4), np.dtype("u1"))]
            fields[4:] = [
                ("DataLength", np.array([8, 9, 12, 8]), np.dtype("u1")),
                ("EDL", np.array([0, 0, 1, 0]), np.dtype("u1")),
            ]
        payload = rng.integers(0, 256, (records, 8)).astype("u1")
        name = f"CAN_{kind}Frame"
        record = np.rec.fromarrays(
            [values.astype(dtype) for _, values, dtype in fields] + [payload],
            dtype=[(f"{name}.{field}", dtype) for field, _, dtype in fields] + [(f"{name}.DataBytes", "u1", (8,))],
        )
        source = Source(name="CAN", path="CAN", comment="", source_type=v4c.SOURCE_BUS, bus_type=v4c.BUS_TYPE_CAN)
        log.append(Signal(record, time / 1e9, name=name, source=source), comment=name, common_timebase=True)
        values = {field: column for field, column, _ in fields}
        rows.extend(
            {
                "time": START + int(time[k]),
                "channel": str(values["BusChannel"][k]),
                "id": int(values["ID"][k]),
                "extended": bool(values["IDE"][k]),
                "fd": bool(values["EDL"][k]),
                "kind": kind.lower(),
                "data": payload[k, : values["DataLength"][k]].tobytes() if kind == "Data" else b"",
                "group": number,
            }
            for k in range(records)
        )
    log.save(path, overwrite=True, compression=compression)
    log.close()
    rows.sort(key=lambda row: (row["time"], row["group"]))
    return [{key: row[key] for key in row if key != "group"} for row in rows]


def rows_of(table: pa.Table) -> list[dict[str, Any]]:
    table = table.set_column(0, "time", table["time"].cast(pa.int64()))
    return list(table.to_pylist())


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]]]:
    """A compressed file of all kinds of frames, and what it holds."""
    path = tmp_path_factory.mktemp("mf4") / "sample.mf4"
    return path, write(path, compression=2, kinds=("Data", "Remote", "Error", "Data"))


@needs_asammdf
def test_groups_are_merged_in_the_order_of_time(sample: tuple[Path, list[dict[str, Any]]]) -> None:
    path, expected = sample
    assert Mf4.sniff(path.read_bytes()[:65_536])
    loaded = "asammdf" in sys.modules
    table, account = read(path)
    assert account == Account(accepted=2000)
    assert rows_of(table) == expected
    assert ("asammdf" in sys.modules) == loaded


@needs_asammdf
def test_a_file_compressed_as_a_whole_is_the_same(sample: tuple[Path, list[dict[str, Any]]], tmp_path: Path) -> None:
    path, expected = sample
    (tmp_path / "a.mf4.gz").write_bytes(gzip.compress(path.read_bytes()))
    table, account = read(tmp_path / "a.mf4.gz")
    assert account == Account(accepted=2000)
    assert rows_of(table) == expected


@needs_asammdf
def test_the_reading_process_does_not_import_asammdf(sample: tuple[Path, list[dict[str, Any]]]) -> None:
    program = (
        "import sys; from pathlib import Path; from wheelprint.ingest.can.mf4 import Mf4\n"
        "from wheelprint.ingest.account import Account\n"
        f"print(sum(map(len, Mf4(Path({str(sample[0])!r})).batches(Account()))), 'asammdf' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "2000 False\n"


@needs_asammdf
@pytest.mark.filterwarnings("ignore")
def test_what_python_can_writes(tmp_path: Path) -> None:
    now = round(datetime.now(UTC).timestamp())  # python-can dates the file itself, and counts from then.
    messages = [
        can.Message(now + 1, 0x123, is_extended_id=False, data=b"\x01\x02", channel=0),
        can.Message(now + 1.25, 0x1234567, is_extended_id=True, data=b"", channel=1),
        can.Message(now + 1.5, 0x7FF, is_extended_id=False, is_remote_frame=True, dlc=4, channel=0),
        can.Message(now + 2, 0x99, is_extended_id=False, is_fd=True, data=bytes(range(64)), channel=0),
        can.Message(now + 2.5, 0, is_extended_id=False, is_error_frame=True, channel=0),
    ]
    with can.MF4Writer(tmp_path / "a.mf4") as writer:
        for message in messages:
            writer.on_message_received(message)
    table, account = read(tmp_path / "a.mf4")
    assert account == Account(accepted=5)
    rows = rows_of(table)
    start = rows[0]["time"]
    assert [round((row.pop("time") - start) / 1e3) for row in rows] == [0, 250_000, 500_000, 1_000_000, 1_500_000]
    names = ("id", "extended", "fd", "kind", "data")
    assert [tuple(row[name] for name in names) for row in rows] == [
        (0x123, False, False, "data", b"\x01\x02"),
        (0x1234567, True, False, "data", b""),
        (0x7FF, False, False, "remote", b""),
        (0x99, False, True, "data", bytes(range(64))),
        (0, False, False, "error", b""),
    ]
    assert len({row["channel"] for row in rows}) == 2


@needs_asammdf
def test_an_unfinalised_file_is_finalised_in_a_copy(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    expected = write(path)
    content = bytearray(path.read_bytes())
    content[:8] = b"UnFinMF "
    content[60:62] = (1).to_bytes(2, "little")  # The counters of the groups are to be updated...
    group = content.find(b"##CG")
    links = int.from_bytes(content[group + 16 : group + 24], "little")
    counter = group + 24 + 8 * links + 8
    assert content[counter : counter + 8] == (500).to_bytes(8, "little")
    content[counter : counter + 8] = bytes(8)  # ... since the logger never wrote them.
    path.write_bytes(content)
    assert Mf4.sniff(bytes(content[:65_536]))
    table, account = read(path)
    assert account == Account(accepted=500)
    assert rows_of(table) == expected
    assert path.read_bytes() == content


@needs_asammdf
def test_frames_of_damaged_records_are_rejected(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    rows = write(path, records=4, spoil=True)
    table, account = read(path)
    assert rows_of(table) == rows[3:]
    assert account == Account(
        accepted=1,
        rejected=3,
        rejections=[
            ("group 0 (CAN_DataFrame), record 1", "its identifier is beyond 11 bits (7FF); the record is damaged"),
            (
                "group 0 (CAN_DataFrame), record 2",
                "its payload is longer than a frame of its kind has (8 bytes, CAN FD 64); the record is damaged",
            ),
            ("group 0 (CAN_DataFrame), record 3", "its payload is shorter than it says; the record is damaged"),
        ],
    )


@needs_asammdf
def test_a_file_without_bus_logging_says_what_it_has(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    log = MDF(version="4.11")
    log.append(Signal(np.arange(3.0), np.arange(3.0), name="speed"), acq_name="Engine")
    log.save(tmp_path / "a.mf4")
    with pytest.raises(InputError) as raised:
        read(tmp_path / "a.mf4")
    assert str(raised.value) == (
        f"{tmp_path / 'a.mf4'}: logs no CAN bus: none of its groups is CAN_DataFrame, CAN_RemoteFrame or "
        "CAN_ErrorFrame; it has Engine. Set the logger to record the bus's frames, not decoded signals"
    )


def test_without_asammdf_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mf4, "find_spec", lambda _: None)
    path = tmp_path / "a.mf4"
    path.write_bytes(b"MDF     4.11    ")
    with pytest.raises(InputError) as raised:
        read(path)
    assert str(raised.value) == f'{path}: is MF4, which asammdf reads; install it: pip install "wheelprint[mf4]"'


DAMAGE = """
import io, sys
from pathlib import Path
import numpy as np
from wheelprint.ingest.can.mf4 import _messages
from wheelprint.ingest.can.mf4_process import write_frames

path, folder = map(Path, sys.argv[1:])
content, rng = path.read_bytes(), np.random.default_rng(5)
for number in range(150):
    damaged = bytearray(content)
    if number % 3 == 0:
        damaged = damaged[: int(rng.integers(64, len(content)))]
    else:
        for place in rng.integers(64, len(content) if number % 3 == 1 else 3000, 3):
            damaged[place] ^= 1 << int(rng.integers(8))
    (folder / "damaged.mf4").write_bytes(damaged)
    output = io.BytesIO()
    try:
        write_frames(folder / "damaged.mf4", str(folder), output)
        crash = None
    except Exception as error:
        crash = type(error).__name__
    output.seek(0)
    notes, frames = {}, 0
    for batch, said in _messages(output):
        frames += len(batch)
        notes |= said
    print([frames, notes.get("rejected"), notes.get("truncated"), "error" in notes, crash])
"""


@needs_asammdf
def test_cut_and_damaged_files_end_as_a_result_or_an_error(
    sample: tuple[Path, list[dict[str, Any]]], tmp_path: Path
) -> None:
    # In one process, since each that imports asammdf takes a second.
    command = [sys.executable, "-c", DAMAGE, str(sample[0]), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    results = [literal_eval(line) for line in done.stdout.splitlines()]
    assert len(results) == 150
    for frames, rejected, truncated, refused, crash in results:
        # It either says why there is nothing, or crashes (which the reader reports), or accounts for what is missing.
        assert (rejected is None) == (refused or crash is not None)
        assert not refused or not frames
        if rejected == 0:
            assert not truncated
    assert sum(crash is not None for *_, crash in results) < 15
    # Of a compressed block that is damaged or cut nothing is left: the groups before and after it are.
    assert sum(rejected is not None and frames + rejected == 2000 for frames, rejected, *_ in results) > 75


@needs_asammdf
def test_a_process_that_crashes_is_an_input_error(sample: tuple[Path, list[dict[str, Any]]], tmp_path: Path) -> None:
    path = tmp_path / "cut.mf4"
    path.write_bytes(sample[0].read_bytes()[:200])
    with pytest.raises(InputError) as raised:
        read(path)
    assert "damaged, or was cut off within its tables" in raised.value.reason


def test_it_refuses_other_content() -> None:
    for head in (b"", b"MDF     3.30    ", b"(1.0) can0 123#00\n", b"\x89MCAP0\r\n", b"UnFinMF"):
        assert not Mf4.sniff(head)
