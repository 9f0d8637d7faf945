"""The report in Chromium: no errors, and nothing from the network."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from wheelprint.report.page import write_report
from wheelprint.schemas.project import Project

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


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
    assert drawn == 19
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
