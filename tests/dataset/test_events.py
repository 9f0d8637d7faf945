"""`events.csv`: what is written comes back, what is wrong is said line by line, and decisions stay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.events import Event, covered, merge_proposals, parse_stamp, read_events, write_events
from wheelprint.schemas.errors import InputError

MS = 1_000_000
START = 1_795_420_800_000 * MS
"""2026-11-23T08:00:00Z"""
HEADER = "recording,start,stop,kind,severity,decision,decided_by,note\n"


def event(start: int, stop: int, decision: str = "proposed", recording: str = "anna/ring") -> Event:
    """An event from and to so many ms after START."""
    return Event(recording, START + start * MS, START + stop * MS, "swerve", 1.25, decision, "", "")  # type: ignore[arg-type]  # the tests give wrong ones, too


def refused(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_events(path)
    return str(caught.value).removeprefix(f"{path}: ")


def test_the_file_is_as_documented(tmp_path: Path) -> None:
    path = tmp_path / "events.csv"
    late = replace(
        event(1500, 2000, "normal"),
        decided_by="Dr. Li",
        decided_at="2026-11-24T10:00:00.000Z",
        note='dog, "big"',
        severity=2 / 3,
    )
    write_events(path, [late, event(100, 1200)])
    assert path.read_bytes().decode() == (
        "recording,start,stop,kind,severity,decision,decided_by,note,decided_at\r\n"
        "anna/ring,2026-11-23T08:00:00.100Z,2026-11-23T08:00:01.200Z,swerve,1.25,proposed,,,\r\n"
        'anna/ring,2026-11-23T08:00:01.500Z,2026-11-23T08:00:02.000Z,swerve,0.667,normal,Dr. Li,"dog, ""big""",'
        "2026-11-24T10:00:00.000Z\r\n"
    )


def test_no_file_no_events(tmp_path: Path) -> None:
    assert read_events(tmp_path / "events.csv") == []


def test_an_unchanged_file_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "events.csv"
    write_events(path, [event(0, 100)])
    before = path.stat()
    write_events(path, [event(0, 100)])
    assert path.stat() == before
    write_events(path, [event(0, 200)])
    assert path.stat().st_ino != before.st_ino


anything = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
hostile = st.one_of(anything, st.sampled_from(["a\rb", "c\r\nd", 'e"', "=1+1,2", "\0", " ", "\ufeff", "'; --"]))
events = st.builds(
    Event,
    recording=st.tuples(hostile, hostile).map(lambda names: f"a{names[0]}/b{names[1]}"),
    start=st.integers(0, 10**12).map(lambda ms: ms * MS),
    stop=st.integers(10**12 + 1, 2 * 10**12).map(lambda ms: ms * MS),
    kind=hostile.map(lambda kind: "k" + kind),
    severity=st.integers(0, 10**6).map(lambda thousandths: thousandths / 1000),
    decision=st.sampled_from(["proposed", "emergency", "normal"]),
    decided_by=hostile,
    note=hostile,
    decided_at=st.sampled_from(["", "2026-11-24T10:00:00.000Z", "2026-11-24 10:00:00+08:00"]),
)


@given(st.lists(events, max_size=5))
def test_what_is_written_comes_back(tmp_path_factory: pytest.TempPathFactory, written: list[Event]) -> None:
    path = tmp_path_factory.mktemp("events") / "events.csv"
    write_events(path, written)
    assert read_events(path) == sorted(written)


def test_a_spreadsheet_may_reorder_columns_mark_the_encoding_and_leave_lines_empty(tmp_path: Path) -> None:
    path = tmp_path / "events.csv"
    path.write_text(
        "note,decided_by,decision,severity,kind,stop,start,recording\n\n"
        "tram,Li,emergency,,tram,2026-11-23T09:00:02+01:00,2026-11-23 08:00:01Z,anna/ring\n",
        encoding="utf-8-sig",
    )
    expected = Event("anna/ring", START + 1000 * MS, START + 2000 * MS, "tram", 0.0, "emergency", "Li", "tram")
    assert read_events(path) == [expected]


def test_all_wrong_lines_are_listed(tmp_path: Path) -> None:
    good = "anna/ring,2026-11-23T08:00:00Z,2026-11-23T08:00:01Z,swerve,1,normal,,\n"
    text = (
        HEADER
        + good
        + "ring,23.11.2026 08:00,2026-11-23T08:00:00,,strong,Normal,,\n"
        + 'anna/ring,2026-11-23T08:00:01Z,2026-11-23T08:00:01Z,swerve,nan,normal,,"two\nlines"\n'
        + good
        + "anna/ring,2026-11-23T08:00:00Z\n"
        + "anna/ring,0001-01-01T00:00:00Z,2026-11-23T08:00:01Z,swerve,-1,,,\n"
    )
    assert refused(tmp_path / "events.csv", text) == (
        "lines 3, 4, 7, 8: "
        "line 3: recording: expected driver/recording, found 'ring', "
        "start: expected ISO 8601 UTC such as 2026-11-23T08:00:00.100Z, found '23.11.2026 08:00', "
        "stop: expected ISO 8601 UTC such as 2026-11-23T08:00:00.100Z, found '2026-11-23T08:00:00' without Z, "
        "kind: expected a word such as hard_braking, found nothing, "
        "severity: expected a number from 0 or nothing, found 'strong', "
        "decision: expected proposed, emergency or normal, found 'Normal'; "
        "line 4: stop: expected a time after start, found 2026-11-23T08:00:01Z after 2026-11-23T08:00:01Z, "
        "severity: expected a number from 0 or nothing, found 'nan'; "
        "line 7: expected 8 fields, found 2; "
        "line 8: start: expected a year from 1678 to 2261, found '0001-01-01T00:00:00Z', "
        "severity: expected a number from 0 or nothing, found '-1', "
        "decision: expected proposed, emergency or normal, found ''"
    )


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "nothing"),
        ("recording;start;stop;kind\n", "recording;start;stop;kind"),
        (HEADER.replace("note", "notes"), "recording, start, stop, kind, severity, decision, decided_by, notes"),
        (
            HEADER.replace("note", "note,note"),
            "recording, start, stop, kind, severity, decision, decided_by, note, note",
        ),
        ('"recording"x,start\n', "not CSV (',' expected after '\"')"),
    ],
)
def test_a_wrong_header_is_refused(tmp_path: Path, text: str, found: str) -> None:
    assert refused(tmp_path / "events.csv", text) == (
        "line 1: expected the columns recording, start, stop, kind, severity, decision, decided_by, note, "
        f"decided_at, separated by commas, found {found}; a spreadsheet may have saved other separators or columns. "
        "Repair this line, or remove the file to begin again with the detectors' proposals"
    )


def test_a_wrong_time_of_decision_is_a_wrong_line(tmp_path: Path) -> None:
    header = HEADER.replace("note\n", "note,decided_at\n")
    line = "anna/ring,2026-11-23T08:00:00Z,2026-11-23T08:00:01Z,swerve,1,normal,Li,,yesterday\n"
    assert refused(tmp_path / "events.csv", header + line) == (
        "line 2: line 2: decided_at: expected ISO 8601 UTC such as 2026-11-23T08:00:00.100Z, found 'yesterday'"
    )


def test_broken_quotes_are_a_wrong_line(tmp_path: Path) -> None:
    assert refused(tmp_path / "events.csv", HEADER + '\n"anna"/ring,1\n"open\n') == (
        "lines 3, 4: line 3: not CSV (',' expected after '\"'); line 4: not CSV (unexpected end of data)"
    )


def test_not_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "events.csv"
    path.write_bytes(HEADER.encode() + b"J\xfcrgen")
    with pytest.raises(InputError) as caught:
        read_events(path)
    assert str(caught.value) == f"{path}: byte {len(HEADER) + 1}: not UTF-8; save the file as UTF-8 text"


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_events(tmp_path)
    assert str(caught.value) == f"{tmp_path}: cannot be read: Is a directory"


def test_a_decision_stays_and_takes_its_stretch_out_of_new_proposals() -> None:
    decided = [event(1000, 2000, "normal"), event(5000, 6000, "emergency")]
    old = [event(0, 500), event(8000, 9000)]
    new = [
        event(900, 2100),  # sticks out on both sides
        event(1200, 1800),  # was judged
        event(2000, 2500),  # touches only
        event(5500, 6500),
        event(1000, 2000, recording="anna/town"),
    ]
    assert merge_proposals(old + decided, new) == [
        event(900, 1000),
        event(1000, 2000, "normal"),
        event(2000, 2100),
        event(2000, 2500),
        event(5000, 6000, "emergency"),
        event(6000, 6500),
        event(1000, 2000, recording="anna/town"),
    ]


def test_a_remaining_padding_is_no_proposal() -> None:
    decided = [event(1000, 2000, "normal"), event(4000, 5000, "emergency"), event(5300, 5400, "normal")]
    new = [
        event(500, 2500),  # 500 ms of padding on both sides
        event(499, 2501),
        event(1500, 4500),  # between two decisions
        event(4500, 5350),  # the same, and as short as a padding
        event(6000, 6100),  # short, but nobody looked at it
        replace(event(900, 2100), kind="standstill"),
    ]
    assert merge_proposals(decided, new, 500 * MS) == [
        event(499, 1000),
        replace(event(900, 1000), kind="standstill"),
        event(1000, 2000, "normal"),
        replace(event(2000, 2100), kind="standstill"),
        event(2000, 2501),
        event(2000, 4000),
        event(4000, 5000, "emergency"),
        event(5000, 5300),
        event(5300, 5400, "normal"),
        event(6000, 6100),
    ]


@given(
    st.lists(st.tuples(st.integers(0, 40), st.integers(1, 20), st.sampled_from(["normal", "emergency", "proposed"]))),
    st.lists(st.tuples(st.integers(0, 40), st.integers(1, 20))),
)
def test_merging_covers_what_was_proposed_or_decided_and_nothing_else(
    known: list[tuple[int, int, str]], fresh: list[tuple[int, int]]
) -> None:
    existing = [event(start, start + length, decision) for start, length, decision in known]
    proposed = [event(start, start + length) for start, length in fresh]
    merged = merge_proposals(existing, proposed)
    time = START + np.arange(70, dtype=np.int64) * MS
    decided = covered(time, [e for e in existing if e.decision != "proposed"])
    assert np.array_equal(
        covered(time, [e for e in merged if e.decision == "proposed"]), covered(time, proposed) & ~decided
    )
    assert [e for e in merged if e.decision != "proposed"] == sorted(e for e in existing if e.decision != "proposed")
    assert merge_proposals(merged, proposed) == merged


@given(st.integers(1, 1000), st.integers(0, 10**6), st.integers(1, 50))
def test_cutting_stamps_to_milliseconds_keeps_the_rows(rate: int, first: int, rows: int) -> None:
    period = round(1e9 / rate)
    time = (np.arange(60, dtype=np.int64) + first) * period
    exact = Event("a/b", int(time[5]), int(time[5]) + rows * period, "swerve", 1.0, "proposed", "", "")
    cut = replace(exact, start=exact.start // MS * MS, stop=exact.stop // MS * MS)
    assert np.array_equal(covered(time, [cut]), covered(time, [exact]))
    assert np.array_equal(covered(time, [exact]), (time >= exact.start) & (time < exact.stop))


def test_stamps_with_more_digits_are_cut() -> None:
    assert parse_stamp(" 2026-11-23T08:00:00.100000999Z ") == START + 100 * MS
