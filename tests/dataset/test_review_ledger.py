"""Changes of single rows: made on a version, never twice, never over somebody else's, and taken back exactly."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest

from wheelprint.dataset.events import Event, read_events, write_events
from wheelprint.dataset.review.ledger import Conflict, Ledger, version_of

SECOND = 1_000_000_000


def event(start: int, stop: int, kind: str = "swerve", recording: str = "anna/ring") -> Event:
    return Event(recording, start * SECOND, stop * SECOND, kind, 1.25, "proposed", "", "")


FOUR = [event(10, 12), event(20, 22), event(30, 32), event(30, 32)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_events(tmp_path / "events.csv", FOUR)
    return tmp_path / "events.csv"


@pytest.fixture
def ledger(path: Path) -> Ledger[Event]:
    return Ledger(path, read_events, write_events)


def decide(ledger: Ledger[Event], key: str, number: int, row: Event, decision: str = "normal") -> Event | None:
    """Decide about a row as it was seen."""
    return ledger.put(key, number, version_of(row), lambda _: replace(row, decision=decision)).after  # type: ignore[arg-type]


def test_equal_rows_have_numbers_of_their_own(ledger: Ledger[Event]) -> None:
    assert ledger.rows()[1] == dict(enumerate(FOUR, 1))


def test_a_change_is_of_one_row_and_in_the_file_at_once(path: Path, ledger: Ledger[Event]) -> None:
    before, rows = ledger.rows()
    changed = decide(ledger, "a", 2, rows[2])
    assert read_events(path) == [FOUR[0], changed, *FOUR[2:]]
    after, rows = ledger.rows()
    assert after != before
    assert rows[2] == changed


def test_a_change_on_an_old_version_is_a_conflict_and_writes_nothing(path: Path, ledger: Ledger[Event]) -> None:
    rows = ledger.rows()[1]
    theirs = decide(ledger, "theirs", 1, rows[1], "emergency")
    content = path.read_bytes()
    with pytest.raises(Conflict) as caught:
        decide(ledger, "mine", 1, rows[1])
    assert (caught.value.number, caught.value.current) == (1, theirs)
    assert path.read_bytes() == content


def test_a_change_sent_twice_is_made_once(path: Path, ledger: Ledger[Event]) -> None:
    first = ledger.put("a", None, None, lambda _: event(50, 51))
    assert ledger.put("a", None, None, lambda _: event(50, 51)) is first
    assert len(read_events(path)) == 5
    back = ledger.reverse("b", "a")
    assert ledger.reverse("b", "a") is back
    assert read_events(path) == FOUR


def test_what_an_editor_changed_keeps_its_number_and_is_not_overwritten(path: Path, ledger: Ledger[Event]) -> None:
    seen = ledger.rows()[1]
    by_hand = [replace(FOUR[0], stop=13 * SECOND, note="tram"), event(15, 16), *FOUR[1:3]]
    write_events(path, by_hand)

    changed = decide(ledger, "a", 2, seen[2])
    assert read_events(path) == [by_hand[0], by_hand[1], changed, FOUR[2]]
    rows = ledger.rows()[1]
    assert {number: row.start // SECOND for number, row in rows.items()} == {1: 10, 5: 15, 2: 20, 3: 30}
    with pytest.raises(Conflict) as caught:
        decide(ledger, "b", 1, seen[1])
    assert caught.value.current == by_hand[0]
    with pytest.raises(Conflict) as caught:
        decide(ledger, "c", 4, seen[4])
    assert caught.value.current is None, "one of the two equal rows was removed"


def test_a_row_of_another_recording_is_another_row(path: Path, ledger: Ledger[Event]) -> None:
    ledger.rows()
    write_events(path, [event(10, 12, recording="anna/town")])
    assert list(ledger.rows()[1]) == [5]


def test_changes_are_taken_back_and_made_again(path: Path, ledger: Ledger[Event]) -> None:
    start = path.read_bytes()
    row = ledger.rows()[1][1]
    decided = decide(ledger, "decide", 1, row)
    assert decided is not None
    ledger.put("move", 1, version_of(decided), lambda _: replace(decided, start=9 * SECOND))
    ledger.put("remove", 2, version_of(FOUR[1]), lambda _: None)
    end = path.read_bytes()
    for number, key in enumerate(("remove", "move", "decide")):
        ledger.reverse(f"undo {number}", key)
    assert path.read_bytes() == start
    for number in (2, 1, 0):
        ledger.reverse(f"redo {number}", f"undo {number}")
    assert path.read_bytes() == end
    assert ledger.rows()[1].keys() == {1, 3, 4}


def test_what_somebody_else_changed_is_not_taken_back(path: Path, ledger: Ledger[Event]) -> None:
    mine = decide(ledger, "mine", 1, ledger.rows()[1][1])
    assert mine is not None
    theirs = decide(ledger, "theirs", 1, mine, "emergency")
    content = path.read_bytes()
    with pytest.raises(Conflict) as caught:
        ledger.reverse("undo", "mine")
    assert caught.value.current == theirs
    assert path.read_bytes() == content
    with pytest.raises(KeyError):
        ledger.reverse("undo", "never made")


def test_two_programs_lose_nothing(tmp_path: Path) -> None:
    """Two ledgers of one file, as two processes have them, decide about every other row each at the same time."""
    path = tmp_path / "events.csv"
    write_events(path, [event(10 * n, 10 * n + 5) for n in range(40)])

    def work(first: int) -> None:
        ledger = Ledger(path, read_events, write_events)
        for number, row in list(ledger.rows()[1].items())[first::2]:
            decide(ledger, str(number), number, row, "normal" if first else "emergency")

    threads = [threading.Thread(target=work, args=(first,)) for first in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [e.decision for e in read_events(path)] == ["emergency", "normal"] * 20
