from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import LONGEST_NAME, Project, encode_name

HOSTILE = [
    "..",
    ".",
    "../../etc",
    "王伟",
    "a b",
    "<script>alert(1)</script>",
    "x" * 400,
    "C:\\x",
    "a/b",
    "~",
    ".hidden",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_encoded_names_are_single_harmless_file_names(name: str, tmp_path: Path) -> None:
    encoded = encode_name(name)
    assert encoded.isascii()
    assert len(encoded) <= LONGEST_NAME
    assert not encoded.startswith(".")
    (tmp_path / encoded).mkdir()
    assert [child.name for child in tmp_path.iterdir()] == [encoded]


@given(st.text(st.characters(codec="utf-8"), min_size=1), st.text(st.characters(codec="utf-8"), min_size=1))
def test_two_names_never_share_a_file_name(one: str, other: str) -> None:
    assert (encode_name(one) == encode_name(other)) == (one == other)


def test_long_names_that_begin_alike_stay_apart() -> None:
    assert encode_name("x" * 300 + "a") != encode_name("x" * 300 + "b")


def write_config(folder: Path, extra: str = "") -> None:
    (folder / "wheelprint.toml").write_text(f"[vehicle]\nwheelbase = 2.8\n{extra}", encoding="utf-8")


def test_recordings_are_found_by_the_layout(tmp_path: Path) -> None:
    for name in ("王伟/2024 <b>", "Anna/one", "Anna/two", ".trash/one"):
        (tmp_path / "raw" / name).mkdir(parents=True)
    write_config(tmp_path)
    assert [r.key for r in Project(tmp_path).recordings()] == ["Anna/one", "Anna/two", "王伟/2024 <b>"]


def test_a_layout_may_hold_both_names_in_one_folder_and_lie_elsewhere(tmp_path: Path) -> None:
    logs = tmp_path / "elsewhere"
    (logs / "day1_anna_take2").mkdir(parents=True)
    project = tmp_path / "project"
    project.mkdir()
    write_config(project, f'[layout]\nrecordings = "{logs}/day1_{{driver}}_{{recording}}"\n')
    (found,) = Project(project).recordings()
    assert (found.driver, found.name, found.folder) == ("anna", "take2", logs / "day1_anna_take2")


def test_no_recording_is_an_error_that_says_where_to_put_one(tmp_path: Path) -> None:
    write_config(tmp_path)
    with pytest.raises(InputError) as error:
        Project(tmp_path).recordings()
    assert str(error.value) == (
        f"{tmp_path}/wheelprint.toml: layout.recordings: no folder matches layout.recordings = "
        "'raw/{driver}/{recording}'; put each recording's logs into such a folder"
    )


def test_tables_that_no_stage_confirmed_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "raw" / "Anna" / "one").mkdir(parents=True)
    write_config(tmp_path)
    with pytest.raises(InputError, match=r"no recording of driver 'Anna' is there yet; run `wheelprint build` first"):
        Project(tmp_path).dataset("Anna")
