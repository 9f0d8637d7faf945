"""The server of the review page: who is let in, what is answered, and that a change lands in the file exactly."""

from __future__ import annotations

import asyncio
import csv
import re
import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.detectors import propose_events
from wheelprint.dataset.events import Event, read_events, write_events
from wheelprint.dataset.review import create_app, serve
from wheelprint.dataset.review.changes import limits_in
from wheelprint.schemas.config import Events
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, describe_output, publish_table
from wheelprint.schemas.tables import CAMERA_FRAMES, SYNCED

TOKEN = "correct-horse"  # noqa: S105  no secret: it opens nothing but this test
HOST = "http://127.0.0.1:8000"
HOSTILE = '<script>alert("x")<!--'
START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


def event(recording: str, at: int, kind: str = "swerve") -> Event:
    """A proposal of two seconds, `at` seconds after the recording's start."""
    return Event(recording, START + at * SECOND, START + (at + 2) * SECOND, kind, 1.25, "proposed", "", "peak 7.5 m/s²")


def synced(seconds: int) -> pa.Table:
    """A drive at 36 km/h."""
    time = START + np.arange(seconds * 10) * (SECOND // 10)
    columns: dict[str, Any] = {f.name: pa.nulls(len(time), f.type) for f in SYNCED}
    columns["time"] = pa.array(time).cast(SYNCED.field("time").type)
    columns["nav_speed"] = pa.array(np.full(len(time), 10.0))
    return pa.table(columns, schema=SYNCED)


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """Two recordings with a synced table, one of them with a hostile name and camera frames, and one without."""
    (tmp_path / "wheelprint.toml").write_text("[vehicle]\nwheelbase = 2.82\n", encoding="utf-8")
    project = Project(tmp_path)
    for driver in ("anna", HOSTILE):
        (tmp_path / "raw" / driver / "ring").mkdir(parents=True)
        publish_table(project.synced_file(driver, "ring"), synced(60))
    (tmp_path / "raw" / HOSTILE / "ring" / "front").mkdir()
    (tmp_path / "raw" / HOSTILE / "ring" / "front" / "1700000000.5.jpg").write_bytes(b"jpeg")
    frame = [[START + SECOND // 2], ["front"], ["front/1700000000.5.jpg"], [None]]
    columns = [pa.array(column, f.type) for column, f in zip(frame, CAMERA_FRAMES, strict=True)]
    index = project.cameras_file(HOSTILE, "ring")
    publish_table(index, pa.Table.from_arrays(columns, schema=CAMERA_FRAMES))
    Manifest(tmp_path).record("recordings", f"{HOSTILE}/ring", {"outputs": [describe_output(tmp_path, index)]})
    write_events(
        project.events_file,
        [event("anna/ring", 5), event("anna/ring", 29, "hard_braking"), event(f"{HOSTILE}/ring", 38), event("x/y", 1)],
    )
    return project


class Guest:
    """Asks the application itself, without a socket, as a page does."""

    def __init__(self, project: Project, reviewer: str | None = None) -> None:
        self.app = create_app(project, TOKEN, reviewer=reviewer)
        self.changes = 0

    def ask(self, method: str, path: str, *, base: str = HOST, token: str = TOKEN, **options: Any) -> httpx.Response:
        async def send() -> httpx.Response:
            transport = httpx.ASGITransport(self.app)
            async with httpx.AsyncClient(transport=transport, base_url=base) as client:
                return await client.request(method, f"/{token}/{path}", **options)

        return asyncio.run(send())

    def lists(self) -> Any:
        return self.ask("GET", "lists").json()

    def change(self, **wish: Any) -> httpx.Response:
        self.changes += 1
        return self.ask("POST", "changes", json={"key": f"change {self.changes}", "book": "events", "by": "Li"} | wish)

    def set(self, row: Mapping[str, Any], **fields: Any) -> httpx.Response:
        return self.change(number=row["number"], version=row["version"], set=fields)


@pytest.fixture
def guest(project: Project) -> Guest:
    return Guest(project)


def lines_of(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as lines:
        return list(csv.reader(lines))


def test_a_decision_changes_its_event_and_nothing_else(project: Project, guest: Guest) -> None:
    before = lines_of(project.events_file)
    row = guest.lists()["events"][2]

    answer = guest.set(row, decision="emergency")

    after = lines_of(project.events_file)
    assert answer.status_code == 200
    assert after[:3] + after[4:] == before[:3] + before[4:]
    assert after[3][:8] == ["anna/ring", *before[3][1:5], "emergency", "Li", "peak 7.5 m/s²"]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", after[3][8])
    stored = answer.json()["row"]
    changed = {"version", "decision", "by", "at"}
    assert {key: stored[key] for key in stored if key not in changed} == {k: row[k] for k in row if k not in changed}
    assert (stored["decision"], stored["by"], stored["at"]) == ("emergency", "Li", after[3][8])


def test_edges_and_notes_of_a_decided_event_say_who_and_of_an_undecided_one_nobody(guest: Guest) -> None:
    row = guest.lists()["events"][1]
    moved = guest.set(row, start=row["start"] - 100, stop=row["stop"] + 1000).json()["row"]
    assert (moved["start"], moved["stop"]) == (row["start"] - 100, row["stop"] + 1000)
    assert (moved["decision"], moved["by"], moved["at"]) == ("proposed", "", "")
    decided = guest.set(moved, decision="normal").json()["row"]
    noted = guest.change(
        number=row["number"], version=decided["version"], by="Bo", set={"note": 'tram, "late"\nand slow'}
    ).json()["row"]
    assert (noted["decision"], noted["by"], noted["note"]) == ("normal", "Bo", 'tram, "late"\nand slow')
    again = guest.set(noted, decision="proposed").json()["row"]
    assert (again["by"], again["at"]) == ("", "")


def test_an_event_is_added_moved_and_removed_by_who_added_it(project: Project, guest: Guest) -> None:
    guest.lists()
    start = START // 10**6 + 50_000
    added = guest.change(add={"recording": 1, "start": start, "stop": start + 2000, "label": "added"}).json()["row"]
    assert read_events(project.events_file)[3] == Event(
        "anna/ring", START + 50 * SECOND, START + 52 * SECOND, "added", 0.0, "emergency", "Li", "", added["at"]
    )
    undecided = guest.set(added, decision="proposed")
    assert (undecided.status_code, undecided.text) == (
        400,
        "what a person added cannot be undecided: the next build would drop it; remove it instead",
    )
    removal = {"number": added["number"], "version": added["version"], "remove": True}
    foreign = guest.change(**removal, by="Bo")
    assert (foreign.status_code, foreign.text) == (
        400,
        "only what you added yourself can be removed; decide about it instead",
    )
    assert guest.change(**removal).json() == {"number": added["number"], "row": None}
    assert len(read_events(project.events_file)) == 4
    proposal = guest.lists()["events"][0]
    assert guest.change(number=proposal["number"], version=proposal["version"], remove=True).status_code == 400


def test_changes_are_taken_back_exactly(project: Project, guest: Guest) -> None:
    content = project.events_file.read_bytes()
    row = guest.lists()["events"][0]
    guest.set(row, decision="normal")
    assert guest.change(undo="change 1").json()["row"] == row
    assert project.events_file.read_bytes() == content
    guest.change(undo="change 2")
    assert read_events(project.events_file)[0].decision == "normal"
    unknown = guest.change(undo="another run's")
    assert (unknown.status_code, unknown.text) == (
        400,
        "this change was made in an earlier run of `wheelprint review` and cannot be taken back",
    )


def test_two_pages_and_an_editor_do_not_overwrite_each_other(project: Project, guest: Guest) -> None:
    row, other = guest.lists()["events"][:2]
    theirs = guest.change(number=row["number"], version=row["version"], by="Bo", set={"decision": "normal"})
    answer = guest.set(row, decision="emergency")
    assert (answer.status_code, answer.json()) == (409, theirs.json())
    by_hand = [e for e in read_events(project.events_file) if e.recording != "x/y"]
    write_events(project.events_file, by_hand)
    assert guest.set(other, decision="emergency").status_code == 200
    assert [(e.decision, e.decided_by) for e in read_events(project.events_file)] == [
        ("normal", "Bo"),
        ("emergency", "Li"),
        ("proposed", ""),
    ]
    assert guest.set(row, note="mine").json()["row"]["by"] == "Bo"


def test_lists_come_once_for_every_state_of_the_files(guest: Guest) -> None:
    lists = guest.lists()
    assert guest.ask("GET", f"lists?since={lists['state']}").status_code == 204
    guest.set(lists["events"][0], decision="normal")
    assert guest.ask("GET", f"lists?since={lists['state']}").json()["events"][0]["decision"] == "normal"
    assert lists["recordings"] == [f"{HOSTILE}/ring", "anna/ring", "x/y"]
    assert [row["recording"] for row in lists["events"]] == [0, 1, 1, 2]
    assert lists["situations"] == []


def test_situations_are_tagged_rejected_and_removed(project: Project, guest: Guest) -> None:
    guest.lists()
    start = START // 10**6
    addition = {"recording": 0, "start": start, "stop": start + 2500, "label": "lane change"}
    added = guest.change(book="situations", add=addition).json()["row"]
    path = project.directory / "situations.csv"
    where = [f"{HOSTILE}/ring", "2023-11-14T22:13:20.000Z", "2023-11-14T22:13:22.500Z"]
    assert lines_of(path) == [
        ["recording", "start", "stop", "situation", "decision", "decided_by", "decided_at", "note"],
        [*where, "lane change", "confirmed", "Li", added["at"], ""],
    ]
    rejection = {"number": added["number"], "version": added["version"], "set": {"decision": "rejected"}}
    rejected = guest.change(book="situations", **rejection).json()["row"]
    assert lines_of(path)[1][4] == "rejected"
    guest.change(book="situations", undo="change 2")
    assert lines_of(path)[1][4] == "confirmed"
    assert rejected["by"] == "Li"
    guest.change(book="situations", number=added["number"], version=added["version"], remove=True)
    assert len(lines_of(path)) == 1
    unknown = guest.change(book="situations", add=addition | {"label": "parking"})
    assert unknown.text == (
        "expected one of lane keeping, lane change, overtaking, intersection, ring road, highway, found 'parking'"
    )


@pytest.mark.parametrize(
    ("wish", "reason"),
    [
        ({}, "expected one of: add, set or remove with a number, undo"),
        ({"number": 1}, "expected one of: add, set or remove with a number, undo"),
        ({"number": 1, "remove": True, "set": {}}, "expected one of: add, set or remove with a number, undo"),
        ({"set": {"kind": "x"}}, "set.kind: Extra inputs are not permitted"),
        ({"set": {"start": 1.5}}, "set.start: Input should be a valid integer"),
        ({"set": {"start": -1}}, "set.start: Input should be greater than or equal to 0"),
        ({"by": ""}, "by: String should have at least 1 character"),
        ({"book": "secrets"}, "book: Input should be 'events' or 'situations'"),
        ({"add": {"recording": 9, "start": 1, "stop": 2, "label": "added"}}, "there is no recording of number 9"),
        (
            {"add": {"recording": 0, "start": 2, "stop": 2, "label": "added"}},
            "the stop must come after the start",
        ),
    ],
)
def test_what_is_no_change_is_refused(project: Project, guest: Guest, wish: dict[str, Any], reason: str) -> None:
    guest.lists()
    content = project.events_file.read_bytes()
    answer = guest.change(**wish)
    assert (answer.status_code, answer.text) == (400, reason)
    assert project.events_file.read_bytes() == content


def test_a_decision_or_edge_that_cannot_be_is_refused(project: Project, guest: Guest) -> None:
    row = guest.lists()["events"][0]
    content = project.events_file.read_bytes()
    assert guest.set(row, decision="perhaps").text == "expected one of proposed, emergency, normal, found 'perhaps'"
    assert guest.set(row, start=row["stop"]).text == "the stop must come after the start"
    assert guest.ask("POST", "changes", content=b"{").status_code == 415
    headers = {"content-type": "application/json"}
    assert guest.ask("POST", "changes", content=b"{", headers=headers).status_code == 400
    assert guest.ask("POST", "changes", content=b"[" * 30_000, headers=headers).status_code == 413
    assert project.events_file.read_bytes() == content


ADDRESSES = ("", "style.css", "main.js", "project", "lists", "recordings/0/window?start=1&stop=2")


@pytest.mark.parametrize("token", ["", "wrong", TOKEN + "x", TOKEN[:-1], "å", ".."])
def test_without_the_token_nothing_is_answered(project: Project, guest: Guest, token: str) -> None:
    content = project.events_file.read_bytes()
    for address in ADDRESSES:
        assert guest.ask("GET", address, token=token).status_code == 404
    assert guest.ask("POST", "changes", token=token, json={}).status_code == 404
    assert guest.ask("GET", "", token=token).headers["content-security-policy"].startswith("default-src 'none'")
    assert project.events_file.read_bytes() == content


@pytest.mark.parametrize(
    "host", ["http://attacker.example", "http://127.0.0.1.attacker.example", "http://192.0.2.1:8000"]
)
def test_a_foreign_host_is_refused(guest: Guest, host: str) -> None:
    for address in ADDRESSES:
        assert guest.ask("GET", address, base=host).status_code == 400
    assert guest.ask("POST", "changes", base=host, json={}).status_code == 400


def test_this_machine_may_be_called_localhost(guest: Guest) -> None:
    assert guest.ask("GET", "", base="http://localhost:1234").status_code == 200


@pytest.mark.parametrize(
    "address",
    [
        "../wheelprint.toml",
        "%2e%2e/%2e%2e/etc/passwd",
        "recordings/..%2f..%2fwheelprint.toml/outline",
        "recordings/9/outline",
        "recordings/-1/outline",
        "recordings/0/frames/0/1",
        "recordings/0/frames/1/0",
        "recordings/0/frames/0/..%2f..%2fwheelprint.toml",
        "recordings/0/frames/front/1700000000.5.jpg",
        "server.py",
        "wheelprint.toml",
    ],
)
def test_no_path_can_be_asked_for(guest: Guest, address: str) -> None:
    guest.lists()
    assert guest.ask("GET", address).status_code == 404


def test_every_answer_is_of_the_page_s_own_origin_and_runs_nothing_else(guest: Guest) -> None:
    for address in ADDRESSES:
        headers = guest.ask("GET", address).headers
        assert headers["content-security-policy"] == (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'"
        )
        assert (headers["cache-control"], headers["x-content-type-options"]) == ("no-store", "nosniff")
        assert headers["referrer-policy"] == "no-referrer"
    page = guest.ask("GET", "").text
    assert re.findall(r'(?:src|href)="([^"]*)"', page) == ["style.css", "icon.svg", "main.js"]
    assert not re.search(r"<style|\son\w+=|style=|<script(?! type=\"module\" src=)", page)


def test_a_window_has_signals_and_frames(guest: Guest) -> None:
    guest.lists()
    start = START // 10**6
    window = guest.ask("GET", f"recordings/0/window?start={start + 400}&stop={start + 600}").json()
    assert window["signals"] == {"time": [0, 100], "columns": {"nav_speed": [10.0, 10.0]}}
    assert window["cameras"] == [{"name": "front", "numbers": [0], "times": [start + 500]}]
    image = guest.ask("GET", "recordings/0/frames/0/0")
    assert (image.content, image.headers["content-type"]) == (b"jpeg", "image/jpeg")
    assert guest.ask("GET", "recordings/2/window?start=1&stop=2").json()["signals"] is None
    assert guest.ask("GET", "recordings/2/outline").json() is None
    assert guest.ask("GET", "recordings/0/outline").json()["start"] == start
    for wrong in ("", "?start=1", "?start=a&stop=2", "?start=2&stop=2", f"?start=1&stop={2**63}"):
        assert guest.ask("GET", "recordings/0/window" + wrong).status_code == 400


def test_a_damaged_index_of_frames_is_told_beside_the_signals(project: Project, guest: Guest) -> None:
    guest.lists()
    index = project.cameras_file(HOSTILE, "ring")
    index.write_bytes(b"no Parquet at all")
    window = guest.ask("GET", f"recordings/0/window?start={START // 10**6}&stop={START // 10**6 + 100}").json()
    assert window["problem"].startswith(f"{index}: not a whole Parquet file (")
    assert window["cameras"] == []
    assert window["signals"]["time"] == [0]


def test_the_page_is_told_of_thresholds_and_of_who_decides(project: Project) -> None:
    facts = Guest(project, "Ägidius").ask("GET", "project").json()
    limits = {panel["lines"][0]["column"]: panel["limits"] for panel in facts["panels"]}
    assert limits["longitudinal_acceleration"] == [-5.0, 4.5]
    assert limits["lateral_acceleration"] == [-6.0, 6.0]
    assert limits["brake_pressure"] == [80.0]
    assert limits["steering_wheel_angle"] == []
    assert (facts["reviewer"], facts["name"]) == ("Ägidius", project.directory.name)
    assert Guest(project).ask("GET", "project").json()["reviewer"] is None


def test_the_thresholds_of_a_proposal_are_read_from_its_note() -> None:
    table = synced(60)
    braking = np.zeros(len(table))
    braking[100:110] = -7.5
    time = table.schema.get_field_index("longitudinal_acceleration")
    table = table.set_column(time, SYNCED.field("longitudinal_acceleration"), pa.array(braking))
    table = table.set_column(1, SYNCED.field("run"), pa.array(np.zeros(len(table), np.int32)))
    (proposal,) = propose_events({"anna/ring": table}, Events(), SECOND // 10)
    assert limits_in(proposal.note) == {"longitudinal_acceleration": -5.0}
    assert limits_in("peak 7.5 m/s²") == {}


def test_a_broken_file_is_explained_and_nothing_is_written(project: Project, guest: Guest) -> None:
    row = guest.lists()["events"][0]
    project.events_file.write_text("recording,start\n", encoding="utf-8")
    for answer in (guest.ask("GET", "lists"), guest.set(row, decision="normal")):
        assert answer.status_code == 422
        assert answer.text.startswith(f"{project.events_file}: line 1: expected the columns recording, start, stop,")
    assert project.events_file.read_text(encoding="utf-8") == "recording,start\n"


def test_a_port_in_use_is_an_input_error(project: Project) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InputError) as caught:
            serve(project, port)
    assert str(caught.value) == (
        f"{project.directory}: port {port}: cannot listen on 127.0.0.1: Address already in use; "
        "take another port, or 0 for any free one"
    )


def test_decisions_at_the_same_time_all_land(project: Project, guest: Guest) -> None:
    rows = guest.lists()["events"]
    answers: list[int] = []

    def decide(row: Mapping[str, Any]) -> None:
        wish: dict[str, Any] = {"key": f"from thread {row['number']}", "book": "events", "by": "Li"}
        wish |= {"number": row["number"], "version": row["version"], "set": {"decision": "normal"}}
        answers.append(guest.ask("POST", "changes", json=wish).status_code)

    threads = [threading.Thread(target=decide, args=(row,)) for row in rows]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == [200] * 4
    assert [e.decision for e in read_events(project.events_file)] == ["normal"] * 4
