"""A small file of every format, and what its whole records are: for tests of damage."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import zstandard
from mcap.writer import CompressionType

from tests.ingest import test_mcap_logs as mcap
from tests.ingest import test_nmea as nmea
from tests.ingest.can import test_asc as asc
from tests.ingest.can import test_blf as blf
from tests.ingest.can import test_candump_console as console
from tests.ingest.can import test_crtd as crtd
from tests.ingest.can import test_csv_logs as csv_logs
from tests.ingest.can import test_database_formats as databases
from tests.ingest.can import test_mf4 as mf4
from tests.ingest.can import test_pcap as pcap
from tests.ingest.can import test_trc as trc
from tests.ingest.oxts import test_kitti as kitti
from tests.ingest.oxts import test_ncom as ncom
from tests.ingest.oxts import test_oxts_csv as oxts_csv
from tests.ingest.oxts import test_xcom as xcom
from tests.ingest.test_reader_compliance import WRITERS, traffic
from wheelprint.ingest.account import Account
from wheelprint.ingest.cameras import CameraIndex
from wheelprint.ingest.can.asc import Asc
from wheelprint.ingest.can.blf import Blf
from wheelprint.ingest.can.candump import Candump
from wheelprint.ingest.can.candump_console import CandumpConsole
from wheelprint.ingest.can.crtd import Crtd
from wheelprint.ingest.can.database import load_databases
from wheelprint.ingest.can.decode import decode
from wheelprint.ingest.can.frames import FrameBatch
from wheelprint.ingest.can.gvret_csv import GvretCsv
from wheelprint.ingest.can.mf4 import Mf4
from wheelprint.ingest.can.pcap import Pcap
from wheelprint.ingest.can.python_can_csv import PythonCanCsv
from wheelprint.ingest.can.trc import Trc
from wheelprint.ingest.mcap_frames import McapFrames
from wheelprint.ingest.mcap_navigation import McapNavigation
from wheelprint.ingest.nmea import Nmea
from wheelprint.ingest.oxts.kitti import Kitti
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.oxts_csv import OxtsCsv
from wheelprint.ingest.oxts.xcom import Xcom

Records = list[Any]
Counted = tuple[int, bool]
"""How many whole records a beginning of a file holds, and whether it ends right behind one."""
ADVANCE = 10_000_000
"""ns from one record to the next."""


@dataclass(frozen=True)
class Sample:
    """A file of one format.

    Attributes:
        write: Writes it into a folder and returns its path.
        read: Reads a file and returns its records; raises `InputError`.
        whole: Counts the whole records of a beginning of the file, by other code than the reader's; None: unknown.
        every: Counts the records of a damaged file, where the format lets one know that: accepted and rejected ones.
        seal: Makes the checksums right after damage, so that what they guard is reached.
        costly: MF4, each reading of which takes about two seconds; records of a group may be rejected by one entry.
        indivisible: A part of the file may be refused.
    """

    write: Callable[[Path], Path]
    read: Callable[[Path, Account], Records]
    whole: Callable[[bytes], Counted] | None = None
    every: Callable[[bytes], int] | None = None
    seal: Callable[[bytes], bytes] | None = None
    costly: bool = False
    indivisible: bool = False


def frames(reader: type[Any]) -> Callable[[Path, Account], Records]:
    def read(path: Path, account: Account) -> Records:
        records: Records = []
        for batch in reader(path).batches(account):
            table = batch.to_arrow()
            records += zip(*(table[name].cast(form).to_pylist() for name, form in _COLUMNS), strict=True)
        assert account.accepted == len(records)
        return records

    return read


_COLUMNS = (
    ("time", pa.int64()), ("channel", pa.string()), ("id", pa.uint32()), ("extended", pa.bool_()), ("fd", pa.bool_()),
    ("kind", pa.string()), ("data", pa.binary()),
)  # fmt: skip


def navigation(reader: type[Any]) -> Callable[[Path, Account], Records]:
    def read(path: Path, account: Account) -> Records:
        return [time for batch in reader(path).batches(account) for time in batch["time"].cast(pa.int64()).to_pylist()]

    return read


def camera(path: Path, account: Account) -> Records:
    return CameraIndex(path).frames(account)["time"].cast(pa.int64()).to_pylist()  # type: ignore[no-any-return]


def database(path: Path, account: Account) -> Records:
    """Return the signals with their messages, once frames have been decoded by them."""
    found, problems = load_databases([path.name], path.parent)
    for problem in problems:
        account.reject(problem.where, problem.reason)
    for repair in found.repairs:
        account.rejections.append((repair.where, f"{repair.found}: {repair.done}"))
    if not found.messages and problems:
        raise problems[0]
    rows = np.arange(16)
    batch = FrameBatch(
        time=rows.astype(np.int64),
        channel=np.zeros(16, np.int16),
        channels=("can0",),
        id=np.resize(np.array([message.id for message in found.messages], np.uint32), 16),
        extended=np.resize(np.array([message.extended for message in found.messages]), 16),
        fd=np.zeros(16, bool),
        kind=np.zeros(16, np.uint8),
        length=(rows % 9).astype(np.uint8),
        data=np.random.default_rng(1).integers(0, 256, (16, 8), np.uint8),
    )
    decode(batch, found)
    account.rejected = len(account.rejections)
    account.truncated = any("cut off" in repair.found for repair in found.repairs)
    account.accepted = sum(len(message.signals) for message in found.messages)
    return [(message.name, signal.name) for message in found.messages for signal in message.signals]


def signals(line: bytes) -> Callable[[bytes], Counted]:
    """Count the lines that place a signal; what ends with a line may be whole."""
    return lambda content: (len(re.findall(rb"^%s.*\n" % line, content, re.MULTILINE)), content.endswith(b"\n"))


def text(content: str | bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / "log"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def repeated(content: str | bytes, header: int, times: int = 12) -> str:
    """Return a text with the lines behind its header several times."""
    lines = (content if isinstance(content, str) else content.decode()).splitlines(keepends=True)
    return "".join(lines[:header] + lines[header:] * times)


def lines(header: int = 0, remark: str = "") -> Callable[[bytes], Counted]:
    """Count lines behind a header that are neither blank nor a remark."""
    other = re.compile(rb"[ \t\r]*(%s)?" % (b"|" + remark.encode() if remark else b""))

    def whole(content: bytes) -> Counted:
        *ended, last = content.split(b"\n")
        return sum(other.fullmatch(line) is None for line in ended[header:]), other.fullmatch(last) is not None

    return whole


def every_line(header: bytes = b"", remark: str = "") -> Callable[[bytes], int]:
    """Count the lines that are neither blank nor a remark; -1: unknown, since the header is damaged or repeated."""
    other = re.compile(rb"[ \t\r]*(%s)?" % (b"|" + remark.encode() if remark else b""))

    def every(content: bytes) -> int:
        if not content.startswith(header) or (header and content.count(header.strip()) != 1):
            return -1
        return sum(other.fullmatch(line) is None for line in content[len(header) :].split(b"\n"))

    return every


def compliance(form: str, count: int = 100) -> Callable[[Path], Path]:
    return lambda folder: WRITERS[form](traffic(count), folder)


def compressed(sample: Sample, compress: Callable[[bytes], bytes], restore: Callable[[bytes], bytes]) -> Sample:
    def write(folder: Path) -> Path:
        path = sample.write(folder)
        path.write_bytes(compress(path.read_bytes()))
        return path

    def whole(content: bytes) -> Counted:
        assert sample.whole is not None
        return sample.whole(restore(content))[0], False

    return replace(sample, write=write, whole=whole, every=None, seal=None)


def zstandard_blocks(content: bytes) -> bytes:
    """Compress as a logger does that flushes now and then, so that what stands before a cut can be had."""
    packer = zstandard.ZstdCompressor().compressobj()
    parts = [
        packer.compress(content[first : first + 1000]) + packer.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
        for first in range(0, len(content), 1000)
    ]
    return b"".join(parts) + packer.flush()


def gunzip(content: bytes) -> bytes:
    return zlib.decompressobj(31).decompress(content)


def unzstd(content: bytes) -> bytes:
    return zstandard.ZstdDecompressor().decompressobj().decompress(content) if len(content) > 18 else b""


def objects_of_blf(content: bytes) -> Counted:
    """Walk the objects, and those in containers as far as they unpack."""

    def walk(content: bytes, place: int) -> Iterator[tuple[int, bytes]]:
        while place + 16 <= len(content):
            size, kind = struct.unpack_from("<II", content, place + 8)
            yield kind, content[place : place + size]
            place += size + size % 4
        yield -1, content[place:]

    count, inner, seam = 0, b"", True
    for kind, thing in walk(content, 144):
        if kind == 10:
            (method,) = struct.unpack_from("<H", thing.ljust(32, b"\0"), 16)
            inner += zlib.decompressobj().decompress(thing[32:]) if method == 2 else thing[32:]
        elif kind < 0:
            seam = not thing
        else:
            count += len(thing) >= struct.unpack_from("<I", thing, 8)[0]
    for kind, thing in walk(inner, 0):
        count += kind not in {-1, 65, 115} and len(thing) >= struct.unpack_from("<I", thing, 8)[0]
    return count, seam


def records_of_pcap(content: bytes) -> Counted:
    place, count = 24, 0
    while place + 16 <= len(content):
        place += 16 + struct.unpack_from("<I", content, place + 8)[0]
        count += place <= len(content)
    return count, place == len(content)


def blocks_of_pcapng(content: bytes) -> Counted:
    place, count = 0, 0
    while place + 12 <= len(content):
        kind, size = struct.unpack_from("<II", content, place)
        place += size
        count += kind == 6 and place <= len(content)
    return count, place == len(content)


def messages_of_mcap(content: bytes) -> Counted:
    """Count the messages of whole records and chunks; only the end of the file is a good end."""

    def walk(content: bytes, place: int) -> Iterator[tuple[int, bytes]]:
        while place + 9 <= len(content):
            kind, size = struct.unpack_from("<BQ", content, place)
            place += 9 + size
            if place <= len(content):
                yield kind, content[place - size : place]

    count = 0
    for kind, body in walk(content, 8):
        if kind == 6:
            (name,) = struct.unpack_from("<I", body, 28)
            codec, packed = body[32 : 32 + name], body[40 + name :]
            if codec == b"zstd":
                packed = zstandard.ZstdDecompressor().decompress(packed)
            elif codec == b"lz4":
                packed = import_module("lz4.frame").decompress(packed)
            count += sum(inner == 5 for inner, _ in walk(packed, 0))
        count += kind == 5
    return count, False


def packets_of_ncom(content: bytes) -> Counted:
    return len(content) // 72, len(content) % 72 == 0


def seal_ncom(content: bytes) -> bytes:
    sealed = bytearray(content)
    for place in range(0, len(sealed) - 71, 72):
        if sealed[place] == 0xE7:
            sealed[place + 71] = sum(sealed[place + 1 : place + 71]) & 0xFF
    return bytes(sealed)


def pages_of_ogg(content: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield begin, end and lacing of the pages, as far as their lengths lead from one to the next."""
    place = 0
    while content[place : place + 4] == b"OggS" and place + 27 <= len(content):
        lacing = content[place + 27 : place + 27 + content[place + 26]]
        end = place + 27 + content[place + 26] + sum(lacing)
        yield place, end, lacing
        place = end


def packets_of_xcom(content: bytes) -> Counted:
    count, end = 0, 0
    for _, end, lacing in pages_of_ogg(content):
        count += sum(part < 255 for part in lacing) if end <= len(content) else 0
    return count, end == len(content)


def seal_xcom(content: bytes) -> bytes:
    for begin, end, _ in list(pages_of_ogg(content)):
        page = content[begin : begin + 22] + bytes(4) + content[begin + 26 : end]
        content = content[: begin + 22] + struct.pack("<I", xcom.crc(page)) + content[begin + 26 :]
    return content


def seal_nmea(content: bytes) -> bytes:
    def seal(match: re.Match[bytes]) -> bytes:
        total = 0
        for octet in match[1]:
            total ^= octet
        return b"$%s*%02X" % (match[1], total)

    return re.sub(rb"\$([^*$\n]*)\*[0-9A-Fa-f]{2}", seal, content)


def blf_of_objects(contained: int | None) -> bytes:
    objects = [content for _, content, _ in blf.OBJECTS] * 4
    if contained is None:
        return blf.header() + b"".join(objects)
    groups = [b"".join(objects[first : first + 9]) for first in range(0, len(objects), 9)]
    return blf.header() + b"".join(blf.container(group, contained) for group in groups)


def pcap_packets() -> list[bytes]:
    kinds = [
        pcap.can(0x123), pcap.can(0x9FFFFFFF, b"\xff"), pcap.can(0x40000010), pcap.can(0x20000004),
        pcap.can(0x7, bytes(range(64)), 4, 72),
    ]  # fmt: skip
    return kinds * 16


def pcapng() -> bytes:
    names = [pcap.interface(pcap.option(2, b"can%d" % bus), pcap.option(9, b"\x09")) for bus in range(2)]
    packets = (pcap.enhanced(packet, pcap.TIME + k * ADVANCE, k % 2, "<") for k, packet in enumerate(pcap_packets()))
    return pcap.section() + b"".join(names) + b"".join(packets)


def mcap_frames(**how: Any) -> Callable[[Path], Path]:
    return lambda folder: mcap.write(folder / "log.mcap", mcap.traffic(80)[0], chunk_size=1000, **how)


def mcap_json(folder: Path) -> Path:
    said: list[mcap.Said] = []
    for k in range(80):
        frame = {"id": k, "is_extended": False, "data": base64.b64encode(bytes(k % 9)).decode()}
        said.append(("can0", "can.Frame", "json", mcap.START + k, json.dumps(frame).encode()))
    return mcap.write(folder / "log.mcap", said, use_chunking=False)


def mcap_navigation(folder: Path) -> Path:
    said: list[mcap.Said] = []
    for k in range(20):
        time = mcap.START + k * ADVANCE
        said += [
            ("/fix", "sensor_msgs/msg/NavSatFix", "cdr", time, mcap.fix(time, 48 + k * 1e-5, 11)),
            ("/imu", "sensor_msgs/msg/Imu", "cdr", time, mcap.imu(time, (0.5, 1.0, 9.8), 0.1, 0.0)),
            ("/odom", "nav_msgs/msg/Odometry", "cdr", time, mcap.odometry(time, 1.0, 10.0, 0.5)),
        ]
    return mcap.write(folder / "log.mcap", said, use_chunking=False)


def mcap_ncom(folder: Path) -> Path:
    packets = ((k, packet) for k, packet in enumerate(ncom_packets()))
    said = [
        ("/ncom", "oxts_msgs/msg/Ncom", "cdr", mcap.START + k, mcap.cdr(mcap.START + k, *[("B", b) for b in packet]))
        for k, packet in packets
    ]
    return mcap.write(folder / "log.mcap", said, use_chunking=False)


def mcap_images(folder: Path) -> Path:
    said = [
        ("/camera", "sensor_msgs/msg/CompressedImage", "cdr", mcap.START, mcap.cdr(mcap.START + k, ("s", b"jpeg\0")))
        for k in range(60)
    ]
    return mcap.write(folder / "log.mcap", said, use_chunking=False)


def ncom_packets() -> list[bytes]:
    kinds: tuple[Callable[[int], bytes], ...] = (
        ncom.clock, ncom.packet, ncom.utc, lambda stamp: ncom.accuracy(stamp, 20, 30),
    )  # fmt: skip
    return [kinds[k % 4](1000 + 10 * k) for k in range(60)]


def xcom_pages() -> bytes:
    pages = [xcom.whole(k, *[xcom.data(40 * k + 10 * j) for j in range(4)]) for k in range(1, 15)]
    return xcom.FIRST + b"".join(pages)


def kitti_folder(folder: Path) -> Path:
    written = {k: kitti.frame(lat=49 + k * 1e-5) for k in range(10)}
    return kitti.write(folder, written, "".join(map(kitti.stamp, range(10))))


def sentences() -> str:
    epochs = []
    for k in range(20):
        clock = f"1235{k:02d}.00"
        epochs += [nmea.rmc(clock), nmea.gga(clock), nmea.sentence("GPVTG,084.4,T,,M,022.4,N,041.5,K")]
        epochs += [nmea.sentence("HEHDT,80.0,T"), nmea.sentence("GPGSV,1,1,00")]
    return "".join(line + "\r\n" for line in epochs)


def console_lines(stamps: Iterable[str]) -> str:
    shapes = [line.split(")", 1)[1] for line in console.LOG.decode().splitlines() if ")" in line]
    return "".join(f" ({stamp}){shapes[k % len(shapes)]}\n" for k, stamp in enumerate(stamps))


def explained(log: str) -> str:
    return re.sub("(?<=ERRORFRAME\n)", "\tcontroller-problem{rx-error-warning}\n\tbus-error\n", log)


def written(name: str, content: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        path.write_text(content, encoding="utf-8")
        return path

    return write


def mf4_log(**how: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / "log.mf4"
        mf4.write(path, records=60, kinds=("Data", "Remote"), **how)
        return path

    return write


CANDUMP = "".join(
    f"(1436509052.{k:06d}) can{k % 3} {frame}\n"
    for k, frame in enumerate(
        ["044#2A366C2BBA", "1FFFFFFF#1122334455667788", "123##5" + "5A" * 12, "123#R8", "20000080#0000000000000001"]
        * 16
    )
)
TRC_REMARK = r";.*|.* EV .*"
NO_FRAME_OF_ASC = r"(?![ ]*\d+\.\d+ +\d+ +[0-9A-Fa-f]+x? +Rx).*"
PYTHON_CAN_HEADER = csv_logs.PYTHON_CAN.splitlines(keepends=True)[0]
DBC = "".join(
    [
        'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: CAR\n\n',
        *(
            f"BO_ {message} M{message}: 8 CAR\n"
            + "".join(f' SG_ S{message}_{k} : {16 * k}|16@1- (0.1,0) [0|0] "deg" CAR\n' for k in range(4))
            + "\n"
            for message in range(100, 106)
        ),
        'BO_ 2147484000 MUX: 8 CAR\n SG_ SELECT M : 0|8@1+ (1,0) [0|0] "" CAR\n',
        ' SG_ ONE m1 : 15|16@0+ (1,0) [0|0] "km/h" CAR\n SG_ TWO m2 : 8|32@1- (1,0) [0|0] "" CAR\n\n',
        'CM_ SG_ 100 S100_0 "Steering; wheel";\nBA_DEF_ SG_ "GenSigStartValue" INT 0 100;\n',
        'BA_DEF_DEF_ "GenSigStartValue" 0;\nBA_ "GenSigStartValue" SG_ 100 S100_0 5;\n',
        'VAL_ 100 S100_1 0 "left" 1 "right" ;\nSIG_VALTYPE_ 2147484000 TWO : 1;\n',
    ]
)

candump = Sample(text(CANDUMP), frames(Candump), lines(), every_line())
consoles = Sample(text(""), frames(CandumpConsole), lines(), every_line())
ascs = Sample(compliance("asc"), frames(Asc), lines(remark=NO_FRAME_OF_ASC))
trcs = [
    Sample(text(repeated(sample, sample.count(";"))), frames(Trc), lines(remark=TRC_REMARK))
    for sample, _ in trc.SAMPLES
]
blfs = Sample(compliance("blf"), frames(Blf), objects_of_blf)
gvrets = {
    name: Sample(text(repeated(sample, 1)), frames(GvretCsv), lines(1), every_line(sample.encode().split(b"\n")[0]))
    for name, (_, sample, _) in zip(csv_logs.NAMES, csv_logs.SAMPLES, strict=True)
    if name != "python-can"
}
pcaps = Sample(text(pcap.pcap(pcap_packets())), frames(Pcap), records_of_pcap)
mcaps = Sample(mcap_frames(compression=CompressionType.NONE, use_chunking=False), frames(McapFrames), messages_of_mcap)
ncoms = Sample(text(b"".join(ncom_packets())), navigation(Ncom), packets_of_ncom, seal=seal_ncom)
xcoms = Sample(text(xcom_pages()), navigation(Xcom), packets_of_xcom, seal=seal_xcom)
nmeas = Sample(text(sentences()), navigation(Nmea), lines(), every_line(), seal=seal_nmea)

SAMPLES: dict[str, Sample] = {
    "candump -L": candump,
    "candump -L .gz": compressed(candump, gzip.compress, gunzip),
    "candump -L .zst": compressed(candump, zstandard_blocks, unzstd),
    "candump -ta": replace(consoles, write=text(console_lines(f"1436509052.{k:06d}" for k in range(80)))),
    "candump -ta -e": replace(
        consoles,
        write=text(explained(console_lines(f"1436509052.{k:06d}" for k in range(80)))),
        whole=lines(remark=r"\t.*"),
        every=None,
    ),
    "candump -td": replace(consoles, write=text(console_lines(f"{k % 2:03d}.{k:06d}" for k in range(80)))),
    "candump -tz": replace(consoles, write=text(console_lines(f"{k:03d}.000100" for k in range(80)))),
    "candump -tA": replace(
        consoles, write=text(console_lines(f"2016-02-29 23:59:{k % 60:02d}.000001" for k in range(60)))
    ),
    "asc of python-can": ascs,
    "asc of CANoe": replace(ascs, write=text(repeated(asc.LOG, 5, 4)), whole=None),
    "asc, decimal, relative": replace(
        ascs,
        write=text(asc.HEADER.replace(b"hex", b"dec").replace(b"absolute", b"relative") + asc.GOOD * 60),
    ),
    "asc .zst": compressed(ascs, zstandard_blocks, unzstd),
    "blf of python-can": blfs,
    "blf, containers unpacked": replace(blfs, write=text(blf_of_objects(0))),
    "blf, containers of zlib": replace(blfs, write=text(blf_of_objects(2))),
    "blf without containers": replace(blfs, write=text(blf_of_objects(None))),
    "blf .gz": compressed(blfs, gzip.compress, gunzip),
    **{f"trc {version}": sample for version, sample in zip(trc.VERSIONS, trcs, strict=True)},
    "trc of python-can": Sample(compliance("trc"), frames(Trc), lines(remark=TRC_REMARK)),
    "python-can csv": Sample(
        text(repeated(csv_logs.PYTHON_CAN, 1)), frames(PythonCanCsv), lines(1), every_line(PYTHON_CAN_HEADER.encode())
    ),
    **{f"gvret csv, {name}": sample for name, sample in gvrets.items()},
    "crtd": Sample(text(repeated(crtd.SAMPLE, 0)), frames(Crtd), lines(remark=r"\S+ \d*C[A-Z][A-Z]( .*)?")),
    "mf4": Sample(mf4_log(), frames(Mf4), costly=True),
    "mf4, compressed": Sample(mf4_log(compression=2), frames(Mf4), costly=True),
    "mcap of can_msgs": mcaps,
    "mcap of can_msgs, zstd": replace(mcaps, write=mcap_frames(compression=CompressionType.ZSTD)),
    "mcap of can_msgs, lz4": replace(mcaps, write=mcap_frames(compression=CompressionType.LZ4)),
    "mcap of can_msgs, chunks": replace(mcaps, write=mcap_frames(compression=CompressionType.NONE)),
    "mcap of JSON": replace(mcaps, write=mcap_json),
    "pcap": pcaps,
    "pcap .gz": compressed(pcaps, gzip.compress, gunzip),
    "pcapng": replace(pcaps, write=text(pcapng()), whole=blocks_of_pcapng),
    "ncom": ncoms,
    "ncom .gz": compressed(ncoms, gzip.compress, gunzip),
    "xcom": xcoms,
    "csv of oxts": Sample(
        text(oxts_csv.HEADER + "".join(oxts_csv.row(1_000_000_000 + k / 100) for k in range(60))),
        navigation(OxtsCsv),
        lines(1),
        every_line(oxts_csv.HEADER.encode()),
    ),
    "kitti": Sample(kitti_folder, navigation(Kitti), lines()),
    "nmea": nmeas,
    "nmea .zst": compressed(nmeas, zstandard_blocks, unzstd),
    "mcap of navigation": Sample(mcap_navigation, navigation(McapNavigation), messages_of_mcap),
    "mcap of ncom": Sample(mcap_ncom, navigation(McapNavigation), messages_of_mcap),
    "dbc": Sample(written("car.dbc", DBC), database, signals(b" SG_ "), indivisible=True),
    "kcd": Sample(written("car.kcd", databases.KCD), database),
    "sym": Sample(written("car.sym", databases.SYM), database, signals(b"(Sig=\\w+ \\d|Mux)"), indivisible=True),
    "arxml": Sample(written("car.arxml", databases.arxml()), database),
    "camera csv": Sample(
        text("time,path\n" + "".join(f"170000000{k % 10}.{k:03d},left/{k:06d}.png\n" for k in range(60))),
        camera,
        every=every_line(b"time,path\n"),
    ),
    "camera mcap": Sample(mcap_images, camera, messages_of_mcap),
}
