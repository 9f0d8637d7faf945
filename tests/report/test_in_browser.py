"""The report and the review page in Chromium: no errors, nothing from the network, and keys that decide."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from wheelprint.dataset.events import read_events, write_events
from wheelprint.report.page import write_report
from wheelprint.schemas.project import Project

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = "/usr/bin/chromium"
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)

pytestmark = pytest.mark.skipif(
    not Path(CHROMIUM).exists(), reason=f"NOT TESTED IN A BROWSER: {CHROMIUM} is absent on this machine"
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="NOT TESTED IN A BROWSER: playwright is not installed"
    )
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        yield browser
        browser.close()


@dataclass
class Witness:
    """Everything a page said and asked for."""

    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def watch(self, page: Page) -> None:
        page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))


@pytest.mark.parametrize("width", [1280, 400])
def test_the_report_draws_every_figure_without_errors_and_without_network(
    browser: Browser, project: Project, width: int
) -> None:
    path = write_report(project)
    witness = Witness()
    page = browser.new_page(viewport={"width": width, "height": 900})
    witness.watch(page)
    page.goto(path.as_uri())
    places = page.locator(".plot")
    for number in range(places.count()):
        places.nth(number).scroll_into_view_if_needed()
        places.nth(number).locator(".main-svg").first.wait_for()
    drawn = places.evaluate_all("boxes => boxes.filter(box => box.querySelector('.plotly .main-svg')).length")
    overflow = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    wrong = page.evaluate("document.querySelectorAll('.plot script, section script:not([type])').length")
    page.close()
    assert drawn == 14
    assert witness.said == []
    assert witness.asked == [path.as_uri()]
    assert overflow == 0, "wide tables scroll within themselves"
    assert wrong == 0, "no name became an element"


def test_the_policy_stops_a_script_that_is_not_part_of_the_page(
    browser: Browser, project: Project, tmp_path: Path
) -> None:
    text = write_report(project).read_text(encoding="utf-8")
    path = tmp_path / "index.html"
    path.write_text(text.replace("<main>", "<main><script>document.title = 'taken over'</script>"), encoding="utf-8")
    page = browser.new_page()
    page.goto(path.as_uri())
    title = page.title()
    page.close()
    assert title == "Wheelprint: Test <Tang>"


@pytest.fixture
def reviewed(project: Project, tmp_path: Path) -> Iterator[tuple[Project, str]]:
    """A copy of the project, and the address of its review page in a process of its own."""
    shutil.copytree(project.directory, tmp_path / "copy")
    code = (
        "import sys; from wheelprint.dataset.review import serve; from wheelprint.schemas.project import Project; "
        "serve(Project(sys.argv[1]), reviewer='Ägidius', announce=lambda address: print(address, flush=True))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "copy")], stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        yield Project(tmp_path / "copy"), server.stdout.readline().strip()
        server.send_signal(signal.SIGINT)
        assert server.wait(20) == 0


def test_keys_and_buttons_of_the_review_page_decide(browser: Browser, reviewed: tuple[Project, str]) -> None:
    project, address = reviewed
    witness = Witness()
    page = browser.new_page()
    witness.watch(page)
    page.goto(address)
    cards = page.locator("article")
    assert cards.count() == 6
    assert page.locator("#count").inner_text() == "6 events, 4 undecided."

    page.keyboard.press("e")
    page.locator("#count", has_text="3 undecided").wait_for()
    for key in "jjkn":
        page.keyboard.press(key)
    page.locator("#count", has_text="2 undecided").wait_for()
    cards.nth(4).get_by_role("button", name="Normal").click()
    page.locator("#count", has_text="1 undecided").wait_for()
    assert cards.nth(0).locator(".facts").first.inner_text().endswith("emergency by Ägidius")
    page.close()

    decisions = [(event.decision, event.decided_by) for event in read_events(project.events_file)]
    assert decisions == [
        ("emergency", "Ägidius"),
        ("normal", "Ägidius"),
        ("proposed", ""),
        ("normal", "A. <Reviewer>"),
        ("normal", "Ägidius"),
        ("emergency", "A. <Reviewer>"),
    ]
    assert witness.said == []
    assert {url.removeprefix(address) for url in witness.asked} == {"", "decisions"}


def test_after_a_change_elsewhere_the_review_page_loads_again_and_says_so(
    browser: Browser, reviewed: tuple[Project, str]
) -> None:
    project, address = reviewed
    page = browser.new_page()
    page.goto(address)
    changed = read_events(project.events_file)[1:]
    write_events(project.events_file, changed)

    page.keyboard.press("e")

    page.locator("#notice", has_text="events.csv was changed elsewhere").wait_for()
    count = page.locator("article").count()
    page.close()
    assert count == 5
    assert read_events(project.events_file) == changed
