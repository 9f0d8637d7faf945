"""NMEA: sentences of one epoch are one sample, dates are carried over midnight, nothing is lost in silence."""

from __future__ import annotations

import gzip
import json
import pickle
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.account import Account
from wheelprint.ingest.nmea import Nmea
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import NAVIGATION

# Widely printed examples, with their checksums.
RMC = "$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A"
GGA = "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47"
LATITUDE = "GGA: expected a latitude such as 04807.038 (dddmm.mmm) and its side"
START = int(datetime(1994, 3, 23, 12, 35, 19, tzinfo=UTC).timestamp()) * 1_000_000_000


def sentence(body: str) -> str:
    total = 0
    for character in body:
        total ^= ord(character)
    return f"${body}*{total:02X}"


def rmc(time: str, date: str = "230394", status: str = "A") -> str:
    return sentence(f"GNRMC,{time},{status},4807.038,N,01131.000,E,10.0,090.0,{date},,,A")


def gga(time: str, latitude: str = "4807.038") -> str:
    return sentence(f"GNGGA,{time},{latitude},N,01131.000,E,4,08,0.9,545.4,M,46.9,M,,")


def read(folder: Path, *sentences: str, end: str = "\r\n") -> tuple[pa.Table, Account]:
    path = folder / "nav.nmea"
    path.write_bytes("".join(line + end for line in sentences).encode("latin-1"))
    account = Account()
    batches = list(Nmea(path).batches(account))
    return pa.Table.from_batches(batches, batches[0].schema if batches else NAVIGATION), account


def times(table: pa.Table) -> list[int]:
    stamps: list[int] = table["time"].cast(pa.int64()).to_pylist()
    return stamps


def test_sentences_of_one_epoch_are_one_sample(tmp_path: Path) -> None:
    table, account = read(tmp_path, GGA, RMC, sentence("GPVTG,084.4,T,,M,022.4,N,041.5,K"), sentence("HEHDT,80.0,T"))
    assert account == Account(accepted=4)
    assert table.schema.equals(NAVIGATION, check_metadata=False)
    assert times(table) == [START]
    sample = {name: value for name, value in table.to_pylist()[0].items() if value is not None and name != "time"}
    assert sample == pytest.approx({
        "latitude": 48 + 7.038 / 60, "longitude": 11 + 31 / 60, "altitude": 545.4, "x": 0.0, "y": 0.0,
        "course": 90 - 84.4, "heading": 10.0, "nav_speed": 22.4 * 1852 / 3600, "nav_status": 1,
    })  # fmt: skip
    origin = json.loads(table.schema.metadata[b"origin"])
    assert origin == pytest.approx({"latitude": 48.1173, "longitude": 11.516666667, "altitude": 545.4})
    assert table.schema.metadata[b"utc_from"] == b"RMC"


def test_without_altitude_there_are_metres_too(tmp_path: Path) -> None:
    moved = sentence("GPRMC,123520,A,4807.138,N,01131.000,E,022.4,084.4,230394,003.1,W")
    table, account = read(tmp_path, RMC, moved)
    assert account == Account(accepted=2)
    assert table["altitude"].null_count == 2
    # A tenth of a minute of arc on the meridian.
    assert table["y"].to_pylist() == pytest.approx([0, 185.3], abs=0.2)
    assert json.loads(table.schema.metadata[b"origin"])["altitude"] == 0


def test_south_and_west_and_kilometres_per_hour(tmp_path: Path) -> None:
    table, _ = read(
        tmp_path,
        sentence("GPRMC,123519.25,A,3352.5,S,07030.0,W,,,230394,,"),
        sentence("GPVTG,270.0,T,,M,,N,36.0,K,A"),
    )
    assert times(table) == [START + 250_000_000]
    assert table["latitude"][0].as_py() == pytest.approx(-33.875)
    assert table["longitude"][0].as_py() == -70.5
    assert table["nav_speed"][0].as_py() == pytest.approx(10.0)
    assert table["course"][0].as_py() == -180.0


def test_slow_cars_have_no_course(tmp_path: Path) -> None:
    table, _ = read(tmp_path, sentence("GPRMC,123519,A,4807.038,N,01131.000,E,000.5,084.4,230394,,"))
    assert table["course"].null_count == 1
    assert table["nav_speed"][0].as_py() == pytest.approx(0.257, abs=1e-3)


def test_invalid_fixes_tell_nothing_but_their_status(tmp_path: Path) -> None:
    table, account = read(
        tmp_path,
        RMC,
        rmc("123520.00", status="V"),
        sentence("GPGGA,123521,,,,,0,00,,,M,,M,,"),
        sentence("GPVTG,,,,,,,,,N"),
        sentence("GPRMC,123522,A,4807.038,N,01131.000,E,022.4,084.4,230394,,,N"),
        sentence("GPRMC,,V,,,,,,,,,,N"),
    )
    assert account == Account(accepted=6)
    assert len(table) == 4
    for name in ("latitude", "longitude", "altitude", "x", "y", "course", "nav_speed"):
        assert table[name].to_pylist()[1:] == [None] * 3
    assert table["nav_status"].to_pylist() == [None, None, 0, None]


def test_other_sentences_are_accepted_and_belong_to_no_sample(tmp_path: Path) -> None:
    others = [sentence("GPGSV,1,1,00"), sentence("PUBX,00,1"), sentence("GPTXT,01,01,02,hello"), sentence("PGRMC,1")]
    table, account = read(tmp_path, *others, "", RMC, "!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D")
    assert len(table) == 1
    assert account == Account(accepted=6)


def test_the_date_is_carried_over_midnight_and_back_to_the_beginning(tmp_path: Path) -> None:
    table, account = read(
        tmp_path,
        gga("235958.00"),
        gga("235959.00"),
        rmc("000000.00", "010100"),
        gga("000001.00"),
        gga("235959.50"),
        gga("000002.00"),
        rmc("120000.00", "020100"),
        gga("120001.00"),
    )
    midnight = int(datetime(2000, 1, 1, tzinfo=UTC).timestamp())
    assert [(time // 1_000_000_000) - midnight for time in times(table)] == [-2, -1, 0, 1, 2, 129_600, 129_601]
    out_of_order = "is out of order with the epochs around it; they changed places, or the clock was set"
    assert account.rejections == [
        ("line 5", f"its time 1999-12-31T23:59:59.500Z {out_of_order}"),
    ]


@pytest.mark.parametrize(("year", "full"), [("80", 1980), ("99", 1999), ("00", 2000), ("79", 2079)])
def test_two_digit_years(tmp_path: Path, year: str, full: int) -> None:
    table, _ = read(tmp_path, rmc("000000", f"0101{year}"))
    assert table["time"].cast(pa.timestamp("s", "UTC"))[0].as_py() == datetime(full, 1, 1, tzinfo=UTC)


def test_repeated_epochs(tmp_path: Path) -> None:
    table, account = read(tmp_path, RMC, rmc("123520"), RMC, rmc("123521"))
    assert len(table) == 3
    repeated = (
        "its time 1994-03-23T12:35:19.000Z is that of another epoch; repeated in recording, the first one is kept"
    )
    assert account == Account(accepted=3, rejected=1, rejections=[("line 3", repeated)])


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("hello", "expected a sentence with its checksum, such as $GPHDT,123.456,T*32; found 'hello'"),
        (RMC[:-3], f"expected a sentence with its checksum, such as $GPHDT,123.456,T*32; found '{RMC[:-3]}'"),
        (
            RMC.replace("4807", "4817"),
            "its checksum is 6A, but its characters make 6B; the sentence is damaged",
        ),
        (sentence("GPRMC,1,A"), "expected at least 9 fields of RMC; found 2: '$GPRMC,1,A*3B'"),
        (rmc("246060"), "RMC: expected a time such as 123519.25 (hhmmss); found '246060'"),
        (rmc("1235"), "RMC: expected a time such as 123519.25 (hhmmss); found '1235'"),
        (rmc("123519", "310294"), "RMC: expected a date such as 230394 (ddmmyy); found '310294'"),
        (gga("123519", "4867.038"), f"{LATITUDE}; found '4867.038,N'"),
        (gga("123519", "9107.038"), f"{LATITUDE}; found '9107.038,N'"),
        (sentence("GPGGA,123519,,,,,9,08,0.9,545.4"), "GGA: expected the quality of the fix (0 to 8); found '9'"),
        (sentence("GPGGA,123519,,,,,1,08,0.9,99999"),
         "GGA: altitude 99999 m is nowhere on earth; the sentence is damaged"),
        (sentence("GPHDT,east,T"), "HDT: expected a number; found 'east'"),
        (sentence("GPHDT,361,T"), "HDT: expected a direction from 0 to 360 deg; found '361'"),
        (sentence("GPVTG,1,T,,M,-10,N,1,K"), "VTG: a speed of -5.14444 m/s; the sentence is damaged"),
    ],
)  # fmt: skip
def test_damaged_sentences_are_rejected(tmp_path: Path, line: str, reason: str) -> None:
    table, account = read(tmp_path, RMC, "", line, rmc("123520"))
    assert len(table) == 2
    assert account == Account(accepted=2, rejected=1, rejections=[("line 3", reason)])


def test_a_log_without_a_date(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, GGA, rmc("123519", status="V"))
    assert str(error.value) == (
        f"{tmp_path / 'nav.nmea'}: its date cannot be known: none of its 2 sentences is a RMC with a valid position, "
        "time and date. The receiver had no reception, or its output leaves RMC out; record with reception and RMC"
    )


def test_cut_anywhere(tmp_path: Path) -> None:
    path = tmp_path / "nav.nmea"
    last = rmc("123520") + "\r\n"
    for size in range(len(last) + 1):
        path.write_text(RMC + "\r\n" + last[:size], newline="")
        account = Account()
        count = sum(len(batch) for batch in Nmea(path).batches(account))
        whole = size >= len(last) - 2
        assert count == 1 + whole
        assert account.truncated == (size > 0 and not whole)
        assert account.rejected == account.truncated
    assert not account.rejections


def test_batches_end_with_epochs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wheelprint.ingest.nmea.BATCH", 3)
    path = tmp_path / "nav.nmea.gz"
    hdt = sentence("GPHDT,10.0,T")
    content = [line for second in range(10) for line in (rmc(f"1235{second:02d}"), gga(f"1235{second:02d}"), hdt)]
    path.write_bytes(gzip.compress("\n".join([*content, *[hdt] * 20]).encode()))
    reader = pickle.loads(pickle.dumps(Nmea(path)))
    account = Account()
    table = pa.Table.from_batches(list(reader.batches(account)))
    assert account == Account(accepted=50)
    assert table["heading"].to_pylist() == pytest.approx([80.0] * 10)
    assert table["altitude"].null_count == 0


@given(
    start=st.datetimes(datetime(1980, 1, 6), datetime(2079, 12, 30)),  # noqa: DTZ001 - UTC, as in NMEA
    steps=st.lists(st.integers(1, 11 * 3_600_000), max_size=20),
    dated=st.integers(0, 20),
)
def test_every_time_comes_back_whichever_sentence_tells_the_date(
    tmp_path_factory: pytest.TempPathFactory, start: datetime, steps: list[int], dated: int
) -> None:
    begin = start.replace(microsecond=0)
    stamps = [begin]
    for step in steps:
        stamps.append(stamps[-1] + timedelta(milliseconds=step))
    stamps = [stamp for stamp in stamps if abs(stamp - stamps[min(dated, len(steps))]) < timedelta(hours=11)]
    chosen = min(dated, len(stamps) - 1)
    lines = [
        rmc(f"{stamp:%H%M%S.%f}", f"{stamp:%d%m%y}") if number == chosen else gga(f"{stamp:%H%M%S.%f}")
        for number, stamp in enumerate(stamps)
    ]
    table, account = read(tmp_path_factory.getbasetemp(), *lines)
    assert account == Account(accepted=len(lines))
    epoch = datetime(1970, 1, 1)  # noqa: DTZ001 - UTC
    assert times(table) == [(stamp - epoch) // timedelta(microseconds=1) * 1000 for stamp in stamps]


def test_random_damage_ends_as_a_result_or_as_an_input_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    text = "\n".join([rmc("123519"), gga("123519"), sentence("GPHDT,10.0,T"), rmc("123520"), gga("123520"), ""])
    content = np.frombuffer(text.encode(), np.uint8)
    path = tmp_path / "nav.nmea"
    for _ in range(200):
        damaged = content.copy()
        damaged[rng.integers(len(content), size=3)] = rng.integers(256, size=3)
        path.write_bytes(damaged.tobytes())
        account = Account()
        try:
            samples = sum(len(batch) for batch in Nmea(path).batches(account))
        except InputError:
            continue
        assert samples <= account.accepted
        assert account.accepted + account.rejected >= 4


def test_sniff() -> None:
    for own in (RMC + "\r\n", f"\r\n{GGA}\n", "18,A*6A\r\n" + RMC + "\r\n$GP", sentence("GNGSV,1,1,00") + "\n"):
        assert Nmea.sniff(own.encode())
    for other in (
        b"", b"$Version=1.1\n", b";$FILEVERSION=2.1\n;$STARTTIME=1\n", b"2011-09-26 13:02:25.594360375\n",
        b"(1436509052.249713) can0 044#2A\n", b"\xe7" * 144, b"OggS\0", b" Time(), Latitude(deg),\n",
    ):  # fmt: skip
        assert not Nmea.sniff(other)
