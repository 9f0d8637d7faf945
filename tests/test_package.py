"""What the package offers to Python."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

import wheelprint
from wheelprint.schemas.tables import FRAMES


def test_every_public_name_is_there_and_documented() -> None:
    assert dir(wheelprint) == sorted([*wheelprint.__all__, "__version__"])
    for name in wheelprint.__all__:
        assert inspect.getdoc(getattr(wheelprint, name)), name
    for name in wheelprint.modeling.__all__:
        assert inspect.getdoc(getattr(wheelprint.modeling, name)), name


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'wheelprint' has no attribute 'red_frames'"):
        _ = wheelprint.red_frames
    with pytest.raises(AttributeError, match="has no attribute 'Mixture'"):
        _ = wheelprint.modeling.Mixture


def test_frames_are_read_and_decoded(tmp_path: Path) -> None:
    log = tmp_path / "can.log"
    log.write_text("(1715562000.5) can0 11F#6400000000\n(1715562000.6) can0 123#R\n", encoding="ascii")
    frames = wheelprint.read_frames(log)
    assert frames.schema.equals(FRAMES)
    assert frames["kind"].to_pylist() == ["data", "remote"]
    assert frames.schema.metadata[b"accepted"] == b"2"
    steer = wheelprint.decode(frames, "byd_tang")["STEER"]
    assert steer["ANGLE"].to_pylist() == [10.0]
    assert steer["channel"].to_pylist() == ["can0"]


def test_a_log_of_the_other_kind_says_which_function_reads_it(tmp_path: Path) -> None:
    log = tmp_path / "can.log"
    log.write_text("(1715562000.5) can0 11F#64\n", encoding="ascii")
    with pytest.raises(wheelprint.InputError) as error:
        wheelprint.read_nav(log)
    assert str(error.value) == f"{log}: is candump, not a navigation log; `wheelprint.read_frames` reads it"
