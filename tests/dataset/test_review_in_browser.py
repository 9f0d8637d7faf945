"""The review page in Chromium: everything with keys, two pages at once, nothing lost, hostile names as text."""

from __future__ import annotations

import csv
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.events import Event, read_events, write_events
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, describe_output, publish_table
from wheelprint.schemas.tables import CAMERA_FRAMES, SYNCED

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
HOSTILE = '<script>alert("x")<!--'
RECORDINGS = (
    f"{HOSTILE}/<img src=x onerror=alert(1)>",
    "anna/..\\..",
    f"{'long ' * 20}/{'name ' * 20}",
    "王小明/环路 1",
)
SMALLEST_PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63606060000000040001f61738550000000049454e44ae426082"
)


def synced(seconds: int) -> pa.Table:
    """A drive around a circle."""
    rows = seconds * 10
    t = np.arange(rows) / 10
    columns = {
        "nav_speed": np.full(rows, 10.0),
        "longitudinal_acceleration": -6 * (np.abs(t % 10 - 5) < 1),
        "steering_wheel_angle": 30 * np.sin(t),
        "x": 100 * np.cos(t / 10),
        "y": 100 * np.sin(t / 10),
    }
    arrays = {f.name: pa.array(columns[f.name]) if f.name in columns else pa.nulls(rows, f.type) for f in SYNCED}
    arrays["time"] = pa.array(START + np.arange(rows) * (SECOND // 10)).cast(SYNCED.field("time").type)
    return pa.table(arrays, schema=SYNCED)


def proposals() -> list[Event]:
    """Four in each recording."""
    note = "longitudinal_acceleration -6 m/s² (threshold 5)"
    return sorted(
        Event(name, START + at * SECOND, START + (at + 2) * SECOND, "hard_braking", 1.2, "proposed", "", note)
        for name in RECORDINGS
        for at in (14, 24, 34, 44)
    )


@pytest.fixture
def project(tmp_path: Path) -> Project:
    (tmp_path / "wheelprint.toml").write_text("[vehicle]\nwheelbase = 2.82\n", encoding="utf-8")
    project = Project(tmp_path)
    for name in RECORDINGS:
        driver, _, recording = name.partition("/")
        (tmp_path / "raw" / driver / recording).mkdir(parents=True)
        publish_table(project.synced_file(driver, recording), synced(60))
    front = tmp_path / "raw" / "王小明" / "环路 1" / "front"
    front.mkdir()
    for second in range(10, 50):
        (front / f"{second}.png").write_bytes(SMALLEST_PNG)
    frames = [
        [START + second * SECOND for second in range(10, 50)],
        ["front"] * 40,
        [f"front/{second}.png" for second in range(10, 50)],
        [None] * 40,
    ]
    columns = [pa.array(column, f.type) for column, f in zip(frames, CAMERA_FRAMES, strict=True)]
    index = project.cameras_file("王小明", "环路 1")
    publish_table(index, pa.Table.from_arrays(columns, schema=CAMERA_FRAMES))
    Manifest(tmp_path).record("recordings", "王小明/环路 1", {"outputs": [describe_output(tmp_path, index)]})
    write_events(project.events_file, proposals())
    return project


@dataclass
class Review:
    """A running `wheelprint review` and what its pages said and asked for."""

    project: Project
    browser: Browser
    address: str
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def open(self) -> Page:
        page = self.browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("dialog", lambda dialog: self.said.append(dialog.message))
        page.on("request", lambda request: self.asked.append(request.url))
        page.goto(self.address)
        page.locator("body[data-ready]").wait_for()
        return page

    @property
    def events(self) -> list[Event]:
        return read_events(self.project.events_file)


@contextmanager
def running(project: Project, browser: Browser, *options: str) -> Iterator[Review]:
    """Run the command itself in a process of its own, until Ctrl-C ends it."""
    command = [sys.executable, "-m", "wheelprint", "review", "--project", str(project.directory), "--no-browser"]
    with subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            yield Review(project, browser, server.stdout.readline().split()[-1])
            server.send_signal(signal.SIGINT)
            assert server.wait(20) == 0
        finally:
            server.kill()
            for context in browser.contexts:
                context.close()


@pytest.fixture
def review(project: Project, browser: Browser) -> Iterator[Review]:
    with running(project, browser, "--by", "Ägidius") as review:
        yield review


def press(page: Page, keys: str) -> None:
    for key in keys.split():
        page.keyboard.press(key)


def stored(page: Page) -> None:
    """Wait until everything that was done is in the file."""
    page.locator("#stored", has_text="All stored").wait_for()


def count(page: Page) -> str:
    return page.locator("#count").inner_text()


def without_when(events: list[Event]) -> list[Event]:
    assert all(bool(e.decided_at) == (e.decision != "proposed") for e in events)
    return [replace(e, decided_at="") for e in events]


def test_an_afternoon_with_keys_only(review: Review) -> None:
    page, second = review.open(), review.open()
    assert count(page) == "0 of 16 decided"

    press(page, "e n e n n e e n e n")  # ten decisions; each goes on to the next
    stored(page)
    press(page, "a a S f D")  # start 0.2 s earlier and 1 s later, stop 0.1 s later and 1 s earlier
    stored(page)
    press(page, "ArrowRight Shift+ArrowRight Shift+ArrowRight m")  # an event that was missed, at the cursor
    page.locator("#label", has_text="added").wait_for()
    stored(page)
    press(page, "w")
    page.keyboard.type("dog on the road")
    press(page, "Control+Enter")
    page.locator("#note", has_text="dog on the road").wait_for()
    stored(page)
    added = next(e for e in review.events if e.kind == "added")
    assert (added.note, added.decision, added.decided_by) == ("dog on the road", "emergency", "Ägidius")
    press(page, "z z")  # without the note, and without the event
    page.locator("#list .entry").nth(16).wait_for(state="detached")
    press(page, "Shift+Z")  # with it again
    page.locator("#list .entry").nth(16).wait_for()
    stored(page)
    page.reload()
    page.locator("body[data-ready]").wait_for()

    expected = proposals()
    decisions: list[Any] = [{"e": "emergency", "n": "normal"}[key] for key in "enenneenen"]
    for number, decision in enumerate(decisions):
        expected[number] = replace(expected[number], decision=decision, decided_by="Ägidius")
    moved = expected[10]
    expected[10] = replace(moved, start=moved.start + 800_000_000, stop=moved.stop - 900_000_000)
    # The cursor stood at the stop, which moved last, and went 2.1 s from there; a second on both sides of it.
    middle = expected[10].stop + 2_100_000_000
    expected.append(Event(moved.recording, middle - SECOND, middle + SECOND, "added", 0.0, "emergency", "Ägidius", ""))
    assert without_when(review.events) == sorted(expected)
    for one in (page, second):
        one.locator("#count", has_text="11 of 17 decided").wait_for()
        assert one.locator("#list .entry").count() == 17
    press(page, "z")  # taking back works after a reload, too
    second.locator("#count", has_text="10 of 16 decided").wait_for()
    assert review.said == []
    assert all(url.startswith(review.address) for url in review.asked), "nothing is asked for elsewhere"


def test_hostile_names_are_text(review: Review) -> None:
    page = review.open()
    names = {entry.get_attribute("title") for entry in page.locator("#list .entry").all()}
    assert names == set(RECORDINGS)
    seen = set()
    for _ in range(16):
        seen.add(page.locator("#recording").inner_text())
        press(page, "j")
    assert {" ".join(name.split()) for name in seen} == {" ".join(name.split()) for name in RECORDINGS}
    assert page.evaluate("document.querySelectorAll('body script, img[src=x]').length") == 0
    overflow = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert overflow == 0
    assert review.said == []


def refused(address: str, host: str | None = None) -> int:
    request = urllib.request.Request(address, headers={"Host": host} if host else {})  # noqa: S310  this machine
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:  # noqa: S310
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def test_who_has_no_token_or_another_name_for_this_machine_is_refused(review: Review) -> None:
    base, token = review.address.rstrip("/").rsplit("/", 1)
    assert refused(review.address) == 200
    assert refused(f"{base}/") == 404
    assert refused(f"{base}/{token[:-1]}/lists") == 404
    assert refused(review.address, "attacker.example") == 400
    assert refused(f"{review.address}lists", "attacker.example:80") == 400
    for path in ("../wheelprint.toml", "%2e%2e/wheelprint.toml", "recordings/0/frames/0/..%2f..%2f..%2fevents.csv"):
        assert refused(review.address + path) == 404


def test_the_map_the_signals_and_the_frames_are_drawn(review: Review) -> None:
    page = review.open()
    page.locator("#by-driver").select_option("王小明")
    press(page, "Escape j j")
    page.locator("#cameras .frame").wait_for()
    frame = page.locator("#cameras .frame")
    assert frame.evaluate("image => image.decode().then(() => image.naturalWidth)") == 1
    before = frame.get_attribute("src")
    press(page, "Shift+ArrowRight")
    assert frame.get_attribute("src") != before, "the frame follows the cursor"
    assert page.locator("#cameras .strip img").count() == 3
    titles = page.locator("#plots .panel-title").all_text_contents()
    assert titles == ["Speed (km/h)", "Longitudinal acceleration (m/s²)", "Steering wheel angle, left + (°)"]
    assert page.locator("#plots .limit-label").all_text_contents() == ["threshold −5"]
    assert "brake pressure" in (page.locator("#plots .quiet").text_content() or "")
    assert page.locator("#map .scale").count() == 1
    box = page.locator("#map .path.whole").bounding_box()
    assert box is not None
    assert box["width"] == pytest.approx(box["height"], rel=0.02), "a circle is one"
    edges = [float(x or 0) for x in (line.get_attribute("x1") for line in page.locator("#plots .edge").all())]
    width = edges[1] - edges[0]
    press(page, "Shift+F")
    page.wait_for_function(
        "width => { const [a, b] = [...document.querySelectorAll('#plots .edge')].map((e) => +e.getAttribute('x1')); "
        "return Math.abs((b - a) / width - 1.5) < 0.01; }",
        arg=width,
    )
    assert review.said == []


def test_a_conflict_is_shown_and_decided(review: Review) -> None:
    page = review.open()
    row = review.events[0]
    page.route("**/lists**", lambda route: route.abort())  # the page hears nothing of what others do
    page.locator("#stored", has_text="No contact").wait_for()
    write_events(review.project.events_file, [replace(row, decision="normal", decided_by="Bo"), *review.events[1:]])
    press(page, "e")
    page.locator("#conflict[open]").wait_for()
    assert "theirs: Bo" in page.locator("#sides").inner_text()
    assert review.events[0].decided_by == "Bo"
    page.unroute("**/lists**")
    press(page, "Enter")  # keep theirs
    page.locator("#count", has_text="1 of 16 decided").wait_for()
    stored(page)
    assert (review.events[0].decision, review.events[0].decided_by) == ("normal", "Bo")

    second = review.open()
    second.route("**/lists**", lambda route: route.abort())
    second.locator("#stored", has_text="No contact").wait_for()
    changed = review.events
    write_events(review.project.events_file, [changed[0], replace(changed[1], note="hand"), *changed[2:]])
    press(second, "n")
    second.locator("#conflict[open]").wait_for()
    second.unroute("**/lists**")
    press(second, "Tab Enter")  # use mine
    second.locator("#count", has_text="2 of 16 decided").wait_for()
    stored(second)
    assert (review.events[1].decision, review.events[1].note) == ("normal", "hand")


def test_what_does_not_arrive_is_shown_and_sent_again(review: Review) -> None:
    page = review.open()
    content = review.project.events_file.read_text(encoding="utf-8")
    page.route("**/changes", lambda route: route.abort())
    press(page, "e n")
    page.locator("#stored.trouble", has_text="2 changes not stored yet").wait_for()
    assert "sent again" in page.locator("#alerts").inner_text()
    assert review.project.events_file.read_text(encoding="utf-8") == content
    page.unroute("**/changes")
    stored(page)
    assert [e.decision for e in review.events[:3]] == ["emergency", "normal", "proposed"]
    assert page.locator("#alerts").inner_text() == ""

    review.project.events_file.write_text("half a fi", encoding="utf-8")
    press(page, "e")
    page.locator("#alerts", has_text="expected the columns").wait_for()
    review.project.events_file.write_text(content, encoding="utf-8")
    stored(page)
    assert [e.decision for e in review.events[:3]] == ["proposed", "proposed", "emergency"]


def test_situations_are_tagged_and_decided_with_keys(review: Review) -> None:
    page = review.open()
    press(page, "ArrowRight b Shift+ArrowRight Shift+ArrowRight t")
    page.locator("#tagging[open]").wait_for()
    press(page, "2")
    stored(page)
    path = review.project.directory / "situations.csv"
    page.locator("#plots .bar.confirmed").wait_for()
    with path.open(encoding="utf-8", newline="") as lines:
        tagged = list(csv.reader(lines))[1]
    stretch = ["2023-11-14T22:13:34.100Z", "2023-11-14T22:13:36.100Z"]
    assert tagged[:6] == [proposals()[0].recording, *stretch, "lane change", "confirmed", "Ägidius"]
    press(page, "v")
    page.locator("#count", has_text="1 of 1 decided").wait_for()
    press(page, "x")
    page.locator("#decision", has_text="rejected").wait_for()
    stored(page)
    assert ",rejected,Ägidius," in path.read_text(encoding="utf-8")
    press(page, "c")
    stored(page)
    press(page, "Delete")
    page.locator("#count", has_text="0 of 0 decided").wait_for()
    stored(page)
    assert len(path.read_text(encoding="utf-8").splitlines()) == 1
    assert review.said == []


def test_the_name_is_asked_for_once(project: Project, browser: Browser) -> None:
    with running(project, browser) as review:
        page = review.open()
        page.locator("#person[open]").wait_for()
        page.locator("#person-name").fill("王小明 <b>")
        press(page, "Enter")
        page.locator("#person[open]").wait_for(state="detached")
        press(page, "e")
        page.locator("#count", has_text="1 of 16 decided").wait_for()
        stored(page)
        assert review.events[0].decided_by == "王小明 <b>"
        page.reload()
        page.locator("body[data-ready]").wait_for()
        assert page.locator("#person[open]").count() == 0
        assert page.locator("#who").inner_text() == "王小明 <b>"


def test_a_key_counts_while_a_closed_question_still_has_the_focus(review: Review) -> None:
    page = review.open()
    page.locator("#person-name").dispatch_event("keydown", {"key": "e"})
    page.locator("#count", has_text="1 of 16 decided").wait_for()
    stored(page)


def test_help_filters_and_buttons(review: Review) -> None:
    page = review.open()
    press(page, "?")
    page.locator("#help[open]").wait_for()
    assert "next undecided" in page.locator("#help").inner_text()
    press(page, "Escape")
    page.get_by_role("button", name="Normal").click()
    page.locator("#count", has_text="1 of 16 decided").wait_for()
    press(page, "/")
    assert page.evaluate("document.activeElement.id") == "by-state"
    page.locator("#by-state").select_option("done")
    page.locator("#list .entry").nth(2).wait_for(state="detached")
    assert page.locator("#list .entry.normal").count() == 1
    page.get_by_role("button", name="Undo").click()
    page.locator("#count", has_text="0 of 16 decided").wait_for()
    stored(page)
    assert review.events == proposals()


def test_five_hundred_events_and_hours_of_data_are_quick(project: Project, browser: Browser) -> None:
    """Ten hours of signals and 500 events: from key to drawing, and the whole page."""
    name = "anna/long"
    (project.directory / "raw" / "anna" / "long").mkdir()
    publish_table(project.synced_file("anna", "long"), synced(36_000))
    write_events(
        project.events_file,
        [
            Event(name, START + 70 * n * SECOND, START + (70 * n + 2) * SECOND, "swerve", 1.2, "proposed", "", "")
            for n in range(1, 501)
        ],
    )
    with running(project, browser, "--by", "Li") as review:
        page = review.open()
        page.locator("#plots > svg").wait_for()
        answers: list[tuple[str, int]] = []
        page.on("response", lambda one: answers.append((one.url, int(one.headers.get("content-length", 0)))))
        press(page, "n " * 20)
        page.locator("#count", has_text="20 of 500 decided").wait_for()
        stored(page)
        page.locator("#when", has_text="22:37:50").wait_for()
        page.locator("#plots > svg").wait_for()
        page.wait_for_timeout(1500)
        assert [e.decision for e in review.events] == ["normal"] * 20 + ["proposed"] * 480
        assert review.said == []
    windows = [size for url, size in answers if "/window" in url]
    assert len(windows) >= 20
    assert max(windows) < 50_000, "only the window is sent"
