"""`situations.csv` by the rules of `events.csv`, and the column that comes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wheelprint.dataset.situations import (
    Situation,
    Verdict,
    read_situations,
    situation_of,
    update_situations,
    write_situations,
)
from wheelprint.schemas.config import Situations
from wheelprint.schemas.errors import InputError

S = 10**9
START = 1_795_420_800 * S
NAMES = Situations().names


def tagged(start: float, stop: float, situation: str, decision: Verdict = "proposed", by: str = "") -> Situation:
    return Situation("anna/ring", START + round(start * S), START + round(stop * S), situation, decision, by, "", "")


def test_the_file_is_as_documented(tmp_path: Path) -> None:
    path = tmp_path / "situations.csv"
    written = [tagged(1.5, 2, "overtaking", "confirmed", "Li"), tagged(0.1, 1.2, "lane change")]
    write_situations(path, written)
    assert path.read_bytes().decode() == (
        "recording,start,stop,situation,decision,decided_by,decided_at,note\r\n"
        "anna/ring,2026-11-23T08:00:00.100Z,2026-11-23T08:00:01.200Z,lane change,proposed,,,\r\n"
        "anna/ring,2026-11-23T08:00:01.500Z,2026-11-23T08:00:02.000Z,overtaking,confirmed,Li,,\r\n"
    )
    assert read_situations(path, NAMES) == sorted(written)


def test_no_file_no_situations(tmp_path: Path) -> None:
    assert read_situations(tmp_path / "situations.csv", NAMES) == []


def test_all_wrong_lines_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "situations.csv"
    path.write_text(
        "recording,start,stop,situation,decision,decided_by,note\n"
        "anna/ring,2026-11-23T08:00:00Z,2026-11-23T08:00:01Z,lane chnage,confirmed,Li,\n"
        "ring,2026-11-23T08:00:01Z,2026-11-23T08:00:01Z,highway,normal,Li,\n"
        "anna/ring,2026-11-23T08:00:02Z,2026-11-23T08:00:03Z,,rejected,Li,\n"
        "anna/ring,2026-11-23T08:00:04Z,2026-11-23T08:00:05Z,Kreisel,confirmed,Li,\n"
        "anna/ring,2026-11-23T08:00:06Z,2026-11-23T08:00:07Z,Kreisel,proposed,,\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError) as caught:
        read_situations(path, NAMES)
    known = "expected lane keeping or lane change or overtaking or intersection or ring road or highway"
    assert str(caught.value) == (
        f"{path}: lines 2, 3, 4, 5: line 2: situation: {known}, found 'lane chnage'; did you mean lane change?; "
        "line 3: recording: expected driver/recording, found 'ring', stop: expected a time after start, found "
        "2026-11-23T08:00:01Z after 2026-11-23T08:00:01Z, decision: expected proposed, confirmed or rejected, "
        "found 'normal'; line 4: situation: expected a name such as lane change, found nothing; "
        f"line 5: situation: {known}, found 'Kreisel'; add it to wheelprint.toml: [situations] names"
    )


def test_decisions_stay_and_proposals_are_replaced_around_them(tmp_path: Path) -> None:
    path = tmp_path / "situations.csv"
    decided = tagged(10, 20, "overtaking", "confirmed", "Li")
    write_situations(path, [decided, tagged(0, 5, "lane change")])
    found = update_situations(path, [tagged(5, 30, "highway"), tagged(12, 15, "lane change")], NAMES)
    assert found == [tagged(5, 10, "highway"), decided, tagged(20, 30, "highway")]
    assert read_situations(path, NAMES) == found


def test_the_situation_of_every_row() -> None:
    time = START + np.arange(10) * S
    found = situation_of(
        time,
        [
            tagged(0, 8, "highway"),
            tagged(2, 4, "lane change"),
            tagged(3, 6, "overtaking", "confirmed"),
            tagged(5, 7, "highway", "confirmed"),
            tagged(1, 9, "ring road", "rejected"),
        ],
    )
    expected = ["highway"] * 2 + ["lane change"] + ["overtaking"] * 2 + ["highway"] * 3 + [None] * 2
    assert found.tolist() == expected
