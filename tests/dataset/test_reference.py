"""Reference paths from files: every way they can be wrong is said, and a car is found on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from numpy.typing import NDArray
from pymap3d import enu2geodetic

from wheelprint.dataset.reference import FARTHEST, SPACING, Reference, find_references, read_reference
from wheelprint.schemas.config import Config
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.store import sha256

Floats = NDArray[np.float64]
ORIGIN = {"latitude": 39.96, "longitude": 116.3, "altitude": 45.0}


def config(reference: str = "reference/{driver}/{recording}.csv") -> Config:
    """A project file with a reference."""
    return Config.model_validate({"vehicle": {"wheelbase": 2.8}, "lookahead": {"reference": reference}})


def written(path: Path, **columns: Any) -> Path:
    """Write columns as CSV or Parquet."""
    table = pa.table(columns)
    (pyarrow.csv.write_csv if path.suffix == ".csv" else pyarrow.parquet.write_table)(table, path)
    return path


def bend(length: float = 300.0, step: float = 0.25) -> tuple[Floats, Floats]:
    """A path that goes straight and then into an ever tighter bend."""
    s = np.arange(0, length, step)
    heading = np.cumsum(np.where(s > 100, (s - 100) / 20000, 0.0) * step)
    return np.cumsum(np.cos(heading) * step), np.cumsum(np.sin(heading) * step)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_both_kinds_of_coordinates_and_of_files_give_the_same_path(tmp_path: Path, suffix: str) -> None:
    x, y = bend()
    drop = -(x**2 + y**2) / (2 * 6.371e6)
    latitude, longitude, _ = enu2geodetic(x, y, drop, ORIGIN["latitude"], ORIGIN["longitude"], ORIGIN["altitude"])
    plane = read_reference(written(tmp_path / f"a{suffix}", x=x, y=y, note=["-"] * len(x)), None, config())
    globe = read_reference(written(tmp_path / f"b{suffix}", longitude=longitude, latitude=latitude), ORIGIN, config())
    for found in (plane, globe):
        assert not found.closed
        np.testing.assert_allclose(np.hypot(np.diff(found.x), np.diff(found.y)), SPACING, rtol=1e-3)
        expected = np.interp(found.x, x, y)
        np.testing.assert_allclose(found.y, expected, rtol=0, atol=2e-3)
    np.testing.assert_allclose(globe.x[:500], plane.x[:500], rtol=0, atol=2e-3)


def test_a_car_is_found_beside_the_path_and_not_far_from_it_or_against_it(tmp_path: Path) -> None:
    x, y = bend()
    reference = read_reference(written(tmp_path / "a.csv", x=x, y=y), None, config())
    heading = np.degrees(np.arctan2(np.diff(y), np.diff(x)))
    rows = np.arange(40, 1000, 10)
    across = np.radians(heading[rows] + 90)
    for offset in (1.5, -0.7):
        place = reference.locate(
            x[rows] + offset * np.cos(across),
            y[rows] + offset * np.sin(across),
            heading[rows],
            np.zeros(len(rows), int),
        )
        np.testing.assert_allclose(place, 0.25 * rows, rtol=0, atol=0.02)
    run = np.zeros(len(rows), int)
    assert np.isnan(reference.locate(x[rows], y[rows] + 2 * FARTHEST, np.zeros(len(rows)), run)[:30]).all()
    assert np.isnan(reference.locate(x[rows], y[rows], heading[rows] + 180, run)).all()
    curvature = reference.curvature(np.array([50.0, 200.0, 260.0]))
    np.testing.assert_allclose(curvature, [0, 100 / 20000, 160 / 20000], rtol=0.01, atol=1e-9)


def test_a_path_that_crosses_itself_is_followed(tmp_path: Path) -> None:
    t = np.linspace(0, 2 * np.pi, 3000)
    x, y = 80 * np.sin(t), 80 * np.sin(t) * np.cos(t)
    reference = read_reference(written(tmp_path / "eight.csv", x=x[:-30], y=y[:-30]), None, config())
    course = np.degrees(np.arctan2(np.gradient(y), np.gradient(x)))
    rows = np.arange(60, 2940, 12)
    place = reference.locate(x[rows], y[rows], course[rows], np.zeros(len(rows), int))
    along = np.append(0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    np.testing.assert_allclose(place, along[rows], rtol=0, atol=0.05)


def test_laps_go_on_at_the_beginning(tmp_path: Path) -> None:
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    reference = read_reference(
        written(tmp_path / "lap.csv", x=50 * np.cos(angle), y=50 * np.sin(angle)), None, config()
    )
    assert reference.closed
    length = SPACING * (len(reference.x) - 1)
    assert length == pytest.approx(2 * np.pi * 50, abs=SPACING)
    turns = np.linspace(0, 6 * np.pi, 300)
    place = reference.locate(49 * np.cos(turns), 49 * np.sin(turns), np.degrees(turns) + 90, np.zeros(len(turns), int))
    np.testing.assert_allclose(np.angle(np.exp(1j * (place * 2 * np.pi / length - turns))), 0, atol=1e-3)
    x, y, first, stop = reference.ahead(np.array([length - 1.0, np.nan]), 40.0)
    assert stop[1] <= first[1]
    steps = np.hypot(np.diff(x[first[0] : stop[0]]), np.diff(y[first[0] : stop[0]]))
    assert steps.sum() >= 39
    np.testing.assert_allclose(steps, SPACING, rtol=0.01)
    np.testing.assert_allclose(reference.curvature(np.array([0.0, length - 1, 7.0])), 1 / 50, rtol=0.01)


def refusal(path: Path, origin: dict[str, float] | None = None, asked: Config | None = None) -> str:
    """The message that a file is refused with, without its path."""
    with pytest.raises(InputError) as raised:
        read_reference(path, origin, asked or config())
    return str(raised.value).removeprefix(f"{path}: ")


def test_what_is_no_path_is_refused(tmp_path: Path) -> None:
    x, y = bend()
    assert refusal(written(tmp_path / "a.csv", east=x, north=y)) == (
        "header: the columns latitude and longitude (deg), or x and y (m), are needed; found: east, north"
    )
    holed = x.copy()
    holed[[3, 8]] = np.nan
    assert refusal(written(tmp_path / "b.parquet", x=holed, y=y)) == (
        "x: a number is needed in every row; missing in 2: row 4, 9"
    )
    assert refusal(written(tmp_path / "c.csv", x=[f"{v:.2f}".replace(".", ",") for v in x], y=y)) == (
        "x: numbers are needed, with a point as decimal mark; found string"
    )
    assert refusal(written(tmp_path / "d.csv", x=x[:20], y=y[:20])) == (
        "20 different points over 4.8 m, and a path of 10 m at least is needed"
    )
    torn = np.where(np.arange(len(x)) >= 600, x + 500, x)
    assert refusal(written(tmp_path / "e.csv", x=torn, y=y)) == (
        "row 600: its points lie up to 200 m apart at most, and from row 600 to the next it is 500 m; is the path in "
        "order and in one piece?"
    )
    assert refusal(written(tmp_path / "f.csv", latitude=x, longitude=y), ORIGIN) == (
        "row 361: latitude within ±90 and longitude within ±180 deg are needed; found 90.25 and 0, and 840 such rows "
        "in all; are the columns exchanged?"
    )
    assert refusal(written(tmp_path / "g.csv", latitude=y, longitude=y)) == (
        "latitude, longitude: the recording has no origin to turn latitude and longitude into x and y; give x and y "
        "instead"
    )
    assert refusal(written(tmp_path / "h.csv", x=x, y=y), asked=config("lane.csv")) == (
        "x, y: x and y are metres from one recording's origin, and this file is for all; give latitude and longitude, "
        "or a file for each recording ({driver} and {recording} in lookahead.reference)"
    )
    (tmp_path / "i.txt").write_text("x,y\n", encoding="utf-8")
    assert refusal(tmp_path / "i.txt") == "a reference is a .csv or .parquet file"
    (tmp_path / "j.parquet").write_bytes(b"PAR1")
    assert refusal(tmp_path / "j.parquet").startswith("not a table that can be read: ")


def test_missing_files_are_named_once(tmp_path: Path) -> None:
    written(tmp_path / "anna.csv", x=[0.0, 1.0], y=[0.0, 1.0])
    assert find_references(tmp_path, "driven", "anna", ["one"]) == ({}, [])
    found, problems = find_references(tmp_path, "{driver}.csv", "anna", ["one", "two"])
    assert found == {name: ("anna.csv", sha256(tmp_path / "anna.csv")) for name in ("one", "two")}
    assert problems == []
    found, (problem,) = find_references(tmp_path, "{driver}.csv", "bo", ["one", "two"])
    assert found == {}
    assert str(problem) == (
        f"{tmp_path}/bo.csv: no such file; lookahead.reference = '{{driver}}.csv' asks for it, and without it bo/one "
        "and 1 more have no lookahead distance. Put the planned path or lane centre there, or write reference = "
        '"driven"'
    )


def test_a_reference_is_what_its_fields_say() -> None:
    straight = Reference(np.arange(0, 50, SPACING), np.zeros(100), closed=False, file=Path("a.csv"))
    x, _, first, stop = straight.ahead(np.array([10.2, 49.0]), 20.0)
    assert first.tolist() == [20, 98]
    assert x[stop - 1].tolist() == [30.0, 49.5]
