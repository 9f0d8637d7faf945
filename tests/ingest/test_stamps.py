"""What a log's own stamps show, against a loop over single records."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.stamps import GAP, Stamps

START = 1_700_000_000_000_000_000
MS = 1_000_000


def stamps_of(times: list[int], cuts: list[int]) -> Stamps:
    stamps = Stamps()
    for part in np.split(np.array(times, np.int64), sorted(cuts)):
        stamps.add(part)
    return stamps


@given(
    st.lists(st.sampled_from([0, 0, 1, 5 * MS, GAP, GAP + 1, 3 * GAP, -1, -7 * MS, -2 * GAP]), max_size=40),
    st.lists(st.integers(0, 41), max_size=4),
)
def test_every_record_is_held_against_the_one_before_wherever_batches_end(steps: list[int], cuts: list[int]) -> None:
    times = np.cumsum([START, *steps]).tolist()
    stamps = stamps_of(times, cuts)

    back = [(a - b, a) for a, b in itertools.pairwise(times) if b < a]
    gaps = [(b - a, a) for a, b in itertools.pairwise(times) if b - a > GAP]
    runs: list[list[int]] = []
    for time in times:
        if runs and runs[-1][0] == time:
            runs[-1].append(time)
        else:
            runs.append([time])
    alike = max(len(run) for run in runs)

    assert (stamps.start, stamps.stop) == (min(times), max(times))
    for finding, expected in ((stamps.backwards, back), (stamps.gaps, gaps)):
        assert finding.count == len(expected)
        if expected:
            worst = max(size for size, _ in expected)
            assert (finding.worst, finding.at) == (worst, next(at for size, at in expected if size == worst))
    assert stamps.repeated.count == len(times) - len(runs)
    if alike > 1:
        assert stamps.repeated.worst == alike
        assert stamps.repeated.at == next(run[0] for run in runs if len(run) == alike)


def test_facts_are_in_seconds_with_their_places() -> None:
    stamps = stamps_of([START, START + 10 * MS, START + 10 * MS, START + 2510 * MS, START + 2000 * MS], [])
    assert stamps.facts() == {
        "backwards": {"count": 1, "worst_s": 0.51, "at": "2023-11-14T22:13:22.510Z"},
        "repeated": {"count": 1, "most_on_one_stamp": 2, "at": "2023-11-14T22:13:20.010Z"},
        "gaps": {"count": 1, "longest_s": 2.5, "at": "2023-11-14T22:13:20.010Z"},
    }


def test_no_record_shows_nothing() -> None:
    stamps = stamps_of([], [])
    assert stamps.start is None
    assert stamps.facts()["gaps"] == {"count": 0, "longest_s": 0.0, "at": None}
    assert stamps.problems(Path("can.log")) == []


def test_a_clock_that_was_set_back_or_stood_still_is_a_problem() -> None:
    times = [START, START + 5000 * MS, START + 1000 * MS, *[START + 6000 * MS] * 251]
    assert [str(problem) for problem in stamps_of(times, [40]).problems(Path("can.log"))] == [
        (
            "can.log: stamps: once a stamp is before that of the record before it, by up to 4.000 s (after "
            "2023-11-14T22:13:25.000Z); the logger's clock was set back, or two recordings stand in one file: then "
            "divide it there"
        ),
        (
            "can.log: stamps: 251 records in a row have the stamp 2023-11-14T22:13:26.000Z; the logger's clock stood "
            "still or counts too coarsely: export the log with stamps of 1 ms or finer"
        ),
    ]


def test_frames_of_several_buses_a_little_out_of_order_are_none() -> None:
    times = [START, START + 100 * MS, START, *[START + 200 * MS] * 250]
    stamps = stamps_of(times, [])
    assert stamps.problems(Path("can.log")) == []
    assert (stamps.backwards.count, stamps.repeated.worst) == (1, 250)
