"""The review page: who is let in, what is shown, and that a decision lands in `events.csv` exactly."""

from __future__ import annotations

import asyncio
import csv
import hashlib
import json
import socket
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.events import Event, read_events, write_events
from wheelprint.dataset.review import create_app, serve
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import publish_table
from wheelprint.schemas.tables import SYNCED

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
    """Two recordings with a synced table, one of them with a hostile name, and one without."""
    project = Project(tmp_path)
    for driver in ("anna", HOSTILE):
        publish_table(project.synced_file(driver, "ring"), synced(60))
    write_events(
        project.events_file,
        [event("anna/ring", 5), event("anna/ring", 29, "hard_braking"), event(f"{HOSTILE}/ring", 38), event("x/y", 1)],
    )
    return project


def request(project: Project, method: str, path: str, *, base: str = HOST, **options: Any) -> httpx.Response:
    """Send one request to the application itself, without a socket."""

    async def send() -> httpx.Response:
        transport = httpx.ASGITransport(create_app(project, TOKEN, reviewer="Ägidius"))
        async with httpx.AsyncClient(transport=transport, base_url=base) as client:
            return await client.request(method, path, **options)

    return asyncio.run(send())


def state_of(project: Project) -> str:
    return hashlib.sha256(project.events_file.read_bytes()).hexdigest()


def decide(project: Project, number: int, decision: str, state: str | None = None) -> httpx.Response:
    body = {"state": state or state_of(project), "event": number, "decision": decision}
    return request(project, "POST", f"/{TOKEN}/decisions", json=body)


def test_a_decision_changes_its_event_and_nothing_else(project: Project) -> None:
    answer = decide(project, 2, "emergency")

    assert answer.status_code == 200
    assert answer.json() == {"state": state_of(project), "decision": "emergency", "decided_by": "Ägidius"}
    with project.events_file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.reader(lines))
    span = "2023-11-14T22:{}.000Z,2023-11-14T22:{}.000Z"
    peak = "peak 7.5 m/s²"
    assert rows == [
        ["recording", "start", "stop", "kind", "severity", "decision", "decided_by", "note"],
        [f"{HOSTILE}/ring", *span.format("13:58", "14:00").split(","), "swerve", "1.25", "proposed", "", peak],
        ["anna/ring", *span.format("13:25", "13:27").split(","), "swerve", "1.25", "proposed", "", peak],
        ["anna/ring", *span.format("13:49", "13:51").split(","), "hard_braking", "1.25", "emergency", "Ägidius", peak],
        ["x/y", *span.format("13:21", "13:23").split(","), "swerve", "1.25", "proposed", "", peak],
    ]


def test_decisions_follow_each_other_by_the_state_the_last_one_returned(project: Project) -> None:
    state = state_of(project)
    for number, decision in enumerate(("emergency", "normal", "normal", "emergency")):
        answer = decide(project, number, decision, state)
        assert answer.status_code == 200
        state = answer.json()["state"]
    assert [e.decision for e in read_events(project.events_file)] == ["emergency", "normal", "normal", "emergency"]


def test_nothing_is_written_when_the_file_changed_since_the_page_was_loaded(project: Project) -> None:
    state = state_of(project)
    write_events(project.events_file, [*read_events(project.events_file), event("anna/ring", 50)])
    content = project.events_file.read_bytes()

    answer = decide(project, 0, "normal", state)

    assert (answer.status_code, answer.text) == (409, "events.csv has changed since the page was loaded")
    assert project.events_file.read_bytes() == content


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"not json",
        b"[]",
        b'"proposed"',
        {"state": "", "event": 0},
        {"state": "", "event": "0", "decision": "normal"},
        {"state": "", "event": 0, "decision": "proposed"},
    ],
)
def test_what_is_no_decision_is_refused(project: Project, body: Any) -> None:
    content = project.events_file.read_bytes()
    raw = body if isinstance(body, bytes) else json.dumps(body | {"state": state_of(project)}).encode()

    answer = request(project, "POST", f"/{TOKEN}/decisions", content=raw)

    assert answer.status_code == 400
    assert answer.text == 'expected {"state": "…", "event": 0, "decision": "emergency" or "normal"}'
    assert project.events_file.read_bytes() == content


@pytest.mark.parametrize("number", [-1, 4])
def test_an_event_that_is_not_there_is_refused(project: Project, number: int) -> None:
    answer = decide(project, number, "normal")
    assert (answer.status_code, answer.text) == (400, f"there are 4 events, not one of number {number}")


@pytest.mark.parametrize("token", ["", "wrong", TOKEN + "x", TOKEN[:-1], "å"])
def test_without_the_token_nothing_is_answered(project: Project, token: str) -> None:
    content = project.events_file.read_bytes()
    body = {"state": state_of(project), "event": 0, "decision": "normal"}
    assert request(project, "GET", f"/{token}/").status_code == 404
    assert request(project, "POST", f"/{token}/decisions", json=body).status_code == 404
    assert project.events_file.read_bytes() == content


@pytest.mark.parametrize(
    "host", ["http://attacker.example", "http://127.0.0.1.attacker.example", "http://192.0.2.1:8000"]
)
def test_a_foreign_host_is_refused(project: Project, host: str) -> None:
    content = project.events_file.read_bytes()
    body = {"state": state_of(project), "event": 0, "decision": "normal"}
    assert request(project, "GET", f"/{TOKEN}/", base=host).status_code == 400
    assert request(project, "POST", f"/{TOKEN}/decisions", base=host, json=body).status_code == 400
    assert project.events_file.read_bytes() == content


def test_this_machine_may_be_called_localhost(project: Project) -> None:
    assert request(project, "GET", f"/{TOKEN}/", base="http://localhost:1234").status_code == 200


class Page(HTMLParser):
    """What the page holds: its tags with attributes, and its text by the innermost tag."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append((self.tags[-1][0], data))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def test_the_page_shows_every_event_and_names_as_text(project: Project) -> None:
    page = Page(request(project, "GET", f"/{TOKEN}/").text)

    assert [a["data-event"] for a in page.all("article")] == ["0", "1", "2", "3"]
    heads = [text for tag, text in page.texts if tag == "h2"]
    assert heads == [
        f"1 · {HOSTILE}/ring · swerve",
        "2 · anna/ring · swerve",
        "3 · anna/ring · hard_braking",
        "4 · x/y · swerve",
    ]
    assert len(page.all("script")) == 1
    assert len(page.all("svg")) == 9, "three plots for each event with a synced table"


def test_the_page_allows_only_its_own_script_and_nothing_from_elsewhere(project: Project) -> None:
    answers = [request(project, "GET", f"/{TOKEN}/") for _ in range(2)]
    policies = [answer.headers["content-security-policy"] for answer in answers]
    nonces = [str(Page(answer.text).all("script")[0]["nonce"]) for answer in answers]
    assert nonces[0] != nonces[1]
    assert policies[0] == (
        f"default-src 'none'; script-src 'nonce-{nonces[0]}'; style-src 'nonce-{nonces[0]}'; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    for tag, attributes in Page(answers[0].text).tags:
        assert "style" not in attributes, tag
        assert not any(name.startswith("on") for name in attributes), tag
        assert not {"src", "href"} & attributes.keys(), tag


def test_a_project_without_events_says_how_they_come(tmp_path: Path) -> None:
    page = Page(request(Project(tmp_path), "GET", f"/{TOKEN}/").text)
    assert page.all("article") == []
    assert any("There are no events." in text for _, text in page.texts)


def test_a_broken_file_is_explained(project: Project) -> None:
    project.events_file.write_text("recording,start\n", encoding="utf-8")
    answer = request(project, "GET", f"/{TOKEN}/")
    assert answer.status_code == 422
    assert answer.text.startswith(f"{project.events_file}: line 1: expected the columns recording, start, stop,")
    assert answer.headers["content-type"].startswith("text/plain")


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
