"""The report as HTML: whole, self-contained, escaped, honest about what is missing; the same bytes every time."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

from wheelprint.report.page import write_report
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project

SECTIONS = [
    "summary", "recordings", "alignment", "events", "dataset", "maps", "lookahead", "clusters", "errors", "personal",
    "experiments", "closed-loop", "prediction", "provenance",
]  # fmt: skip
VOID = {"meta", "link", "br", "img", "input", "hr"}
HOSTILE = '<script>alert("x")<!--'
CHINESE = "王小明"


class Page(HTMLParser):
    """The page as a browser takes it apart: tags, text by section, scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.section = ""
        self.text: dict[str, str] = {}
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag == "section":
            self.section = str(dict(attrs)["id"])
        if tag == "script":
            self.scripts.append((dict(attrs), ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open, tag
        assert self.open.pop() == tag, "tags are nested properly"
        if tag == "dt":
            self.handle_data(" ")
        if tag == "section":
            self.section = ""

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        else:
            self.text[self.section] = self.text.get(self.section, "") + data

    def figures(self) -> Iterator[dict[str, object]]:
        for attributes, text in self.scripts:
            if attributes.get("type") == "application/json":
                yield json.loads(text)


@pytest.fixture(scope="module")
def path(project: Project) -> Path:
    return write_report(project)


@pytest.fixture(scope="module")
def page(path: Path) -> Page:
    return Page(path.read_text(encoding="utf-8"))


def test_all_sections_are_there_and_in_the_contents(page: Page) -> None:
    assert [a["id"] for tag, a in page.tags if tag == "section"] == SECTIONS
    assert [a["href"] for tag, a in page.tags if tag == "a"] == [f"#{name}" for name in SECTIONS]
    assert page.open == [], "every element is closed"


def test_nothing_is_loaded_from_anywhere(page: Page) -> None:
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base"), tag
        assert "src" not in attributes, tag
        for name, value in attributes.items():
            assert not re.search(r"(https?:)?//", value or ""), (tag, name, value)
            assert not name.startswith("on"), (tag, name)
    style = "".join(page.text[""].split())
    assert "url(" not in style
    assert "@import" not in style


def test_the_policy_lets_only_the_pages_own_two_scripts_run(page: Page) -> None:
    (policy,) = [str(a["content"]) for tag, a in page.tags if a.get("http-equiv") == "Content-Security-Policy"]
    run = [text for attributes, text in page.scripts if "type" not in attributes]
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in run]
    assert len(run) == 2
    assert run[0].lstrip().startswith("/**\n* plotly.js")
    assert policy == (
        f"default-src 'none'; script-src 'sha256-{hashes[0]}' 'sha256-{hashes[1]}'; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def test_plotly_is_there_once_and_the_file_is_small(path: Path) -> None:
    assert path.read_text(encoding="utf-8").count("* plotly.js v") == 1
    assert path.stat().st_size < 7e6


def test_names_are_shown_as_they_are(page: Page) -> None:
    for section in ("summary", "recordings", "alignment", "events", "lookahead", "clusters", "errors", "provenance"):
        assert HOSTILE in page.text[section], section
        assert CHINESE in page.text[section], section
    assert "A. <Reviewer>" in page.text["events"]
    assert "Test <Tang>" in page.text["summary"]


def test_names_in_figures_are_escaped_for_plotly(page: Page) -> None:
    figures = list(page.figures())
    texts = json.dumps(figures, ensure_ascii=False)
    assert '&lt;script&gt;alert(\\"x\\")&lt;!--' in texts
    assert "<script" not in texts
    assert len(figures) == 3 + 1 + 3 + 2 + 1 + 4 + 5, "alignment, timeline, maps, lookahead, BIC, errors, personal"


def test_every_axis_says_what_it_shows(page: Page) -> None:
    untitled = [
        (number, name)
        for number, figure in enumerate(page.figures())
        for name, axis in figure["layout"].items()  # type: ignore[attr-defined]
        if re.match(r"[xy]axis", name) and not axis["title"].get("text") and "ticktext" not in axis
    ]
    assert untitled == []


def test_the_counts_add_up(page: Page) -> None:
    assert "399,604" in page.text["summary"]
    assert "records in = 399,603 accepted + 1 rejected" in page.text["summary"]


def test_the_summary_says_what_was_calibrated_and_what_was_given(page: Page) -> None:
    summary = " ".join(page.text["summary"].split())
    assert "15.930 ± 0.021 steering ratio, estimated ± standard error" in summary
    assert "−1.42° steering offset, given in wheelprint.toml" in summary


def test_problems_stand_first_and_are_complete(page: Page) -> None:
    summary = page.text["summary"]
    assert summary.split("\n", 2)[1].strip() == "1 Summary"
    shown = summary[: summary.index("Test <Tang>")]
    assert "3 problems" in shown
    assert "1 of 120002 records rejected: <8 bytes>" in shown
    assert "the CAN clock was not aligned: correlation 0.31 is below 0.9" in shown
    assert "4 proposed events are left out and nobody has looked at them yet" in shown


def test_the_same_project_gives_the_same_bytes(project: Project, path: Path) -> None:
    before = path.read_bytes()
    write_report(project)
    assert path.read_bytes() == before


def test_an_empty_project_says_which_command_makes_what_is_missing(bare_project: Project) -> None:
    page = Page(write_report(bare_project).read_text(encoding="utf-8"))
    assert [a["id"] for tag, a in page.tags if tag == "section"] == SECTIONS
    said = {name: " ".join(page.text[name].split()) for name in SECTIONS}
    for section in ("summary", "recordings", "alignment", "maps", "provenance"):
        assert "No recording was converted yet. wheelprint convert makes it." in said[section], section
    assert said["events"] == "4 Events No events were proposed yet. wheelprint build makes it."
    assert said["dataset"] == "5 Dataset The dataset was not built yet. wheelprint build makes it."
    assert said["lookahead"] == "7 Lookahead The dataset was not built yet. wheelprint build makes it."
    assert said["clusters"] == "8 Clusters The dataset was not built yet. wheelprint build makes it."
    assert said["errors"].count("wheelprint evaluate") == 2
    assert "wheelprint train" in said["prediction"]
    assert list(page.figures()) == []


def test_damaged_files_are_problems_on_the_page(project: Project, tmp_path: Path) -> None:
    shutil.copytree(project.directory, tmp_path / "copy")
    damaged = Project(tmp_path / "copy")
    damaged.synced_file(HOSTILE, "ring & road").write_bytes(b"PAR1 no more")
    damaged.events_file.write_text("recording\n", encoding="utf-8")
    damaged.data_card_file(CHINESE).write_text("{", encoding="utf-8")
    (damaged.results_folder / "lookahead.csv").write_text("driver,model\n", encoding="utf-8")
    results = damaged.results_folder / "motion_primitives.csv"
    results.write_text(results.read_text(encoding="utf-8").replace("0.95", "high"), encoding="utf-8")

    page = Page(write_report(damaged).read_text(encoding="utf-8"))

    summary = page.text["summary"]
    assert "not a whole Parquet file" in summary
    assert "events.csv, line 1: expected the columns" in summary
    assert "_card.json" in summary
    assert "wheelprint build --force" in summary
    assert "results/lookahead.csv, line 1: the columns components, regressors, fold, split, mean_error" in summary
    assert "coverage_95: expected a number, found 'high'" in summary


def test_a_recording_without_entry_is_named(project: Project, tmp_path: Path) -> None:
    shutil.copytree(project.directory, tmp_path / "copy")
    (tmp_path / "copy" / "raw" / "new" / "drive").mkdir(parents=True)
    page = Page(write_report(Project(tmp_path / "copy")).read_text(encoding="utf-8"))
    assert "new/drive: not in the manifest: not converted yet, or it could not be" in page.text["summary"]


def test_a_wrong_project_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        write_report(Project(tmp_path))
