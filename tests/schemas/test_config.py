from __future__ import annotations

from pathlib import Path

import pytest

from wheelprint.schemas.config import read_config
from wheelprint.schemas.errors import InputError


def read(folder: Path, text: str) -> str:
    """Return the message that a project file gives, after its path."""
    path = folder / "wheelprint.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_config(path)
    assert error.value.path == str(path)
    return f"{error.value.where} | {error.value.reason}"


def test_defaults_need_only_the_wheelbase(tmp_path: Path) -> None:
    path = tmp_path / "wheelprint.toml"
    path.write_text("[vehicle]\nwheelbase = 2.82\n", encoding="utf-8")
    config = read_config(path)
    assert (config.sync.period, config.dataset.smoothing_window, config.dataset.folds) == (100_000_000, 5, 10)
    assert config.models.motion_primitives.future_steps == 50


def test_a_signal_is_a_name_or_a_table(tmp_path: Path) -> None:
    path = tmp_path / "wheelprint.toml"
    path.write_text(
        '[vehicle]\nwheelbase = 2.8\n[can.signals]\nspeed = "A.b"\n'
        'yaw_rate = { signal = "C.d", sign = -1, scale = 2 }\n',
        encoding="utf-8",
    )
    signals = read_config(path).can.signals
    assert (signals["speed"].signal, signals["speed"].scale) == ("A.b", None)
    assert (signals["yaw_rate"].sign, signals["yaw_rate"].scale) == (-1, 2)


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_config(tmp_path / "wheelprint.toml")
    assert error.value.reason == "no such file. A project is a folder with this file; `wheelprint init` writes one"


def test_all_wrong_keys_are_named_at_once(tmp_path: Path) -> None:
    message = read(tmp_path, "[vehicle]\nwheelbas = 2.8\n[sync]\nrate = -1\n[dataset]\nsmoothing_window = 4\n")
    assert message == (
        "vehicle.wheelbase, vehicle.wheelbas, sync.rate, dataset.smoothing_window | "
        "vehicle.wheelbase: missing; it has no default; "
        "vehicle.wheelbas: unknown key; did you mean wheelbase?; "
        "sync.rate: Input should be greater than 0, found -1; "
        "dataset.smoothing_window: a centred window needs an odd number of samples, found 4"
    )


def test_a_signal_that_is_not_canonical_is_refused_with_the_vocabulary(tmp_path: Path) -> None:
    message = read(tmp_path, '[vehicle]\nwheelbase = 2.8\n[can.signals]\nsped = "A.b"\n')
    assert message.startswith(
        "can.signals | can.signals: not canonical: sped; the canonical signals of CAN are steering_"
    )


def test_broken_toml_says_the_line(tmp_path: Path) -> None:
    assert "at line 2" in read(tmp_path, "[vehicle]\nwheelbase = \n")


def test_other_encodings_say_so(tmp_path: Path) -> None:
    path = tmp_path / "wheelprint.toml"
    path.write_bytes("[vehicle]\nname = 'Käfer'\n".encode("latin-1"))
    with pytest.raises(InputError) as error:
        read_config(path)
    assert str(error.value) == f"{path}: byte 19: not UTF-8; save the file as UTF-8 text"


def test_what_a_mapping_of_navigation_lacks_or_misspells_is_said(tmp_path: Path) -> None:
    vehicle = "[vehicle]\nwheelbase = 2.8\n"
    message = read(tmp_path, f'{vehicle}[nav.can]\nlatitud = "A.b"\nfoo = "A.b"\n')
    assert message.startswith(
        "nav.can | nav.can: no quantity of navigation: latitud (did you mean latitude?), foo; known are latitude, "
    )
    assert ", course_clockwise, " in message
    assert "unix_time" in message
    assert read(tmp_path, f'{vehicle}[nav.columns]\nlatitude = "Lat"\n').startswith(
        "nav | nav: a table is read by nav.files, nav.time and nav.columns; missing: nav.files, nav.time, found "
    )
    message = read(tmp_path, f'{vehicle}[nav]\nfiles = "*"\ntime = {{ column = "t", format = "gps-week-s" }}\n')
    assert message.startswith(
        "nav.time | nav.time: `week` names the column of the GPS week; it goes with the format gps-week-s, and only it"
    )
    message = read(tmp_path, f'{vehicle}[nav.can.latitude]\nsignal = "A.b"\nvalit = "c"\n')
    assert message == "nav.can.latitude.valit | nav.can.latitude.valit: unknown key; did you mean valid?"


def test_a_mapping_of_navigation(tmp_path: Path) -> None:
    path = tmp_path / "wheelprint.toml"
    path.write_text(
        '[vehicle]\nwheelbase = 2.8\n[nav]\nformat = "csv"\nfiles = "gps*.csv"\n'
        'time = { column = "t", format = "unix-ms" }\n'
        '[nav.columns]\nlatitude = "Lat"\nnav_speed = { column = "v", unit = "km/h" }\n'
        '[nav.can]\nlatitude = "A.b"\nlongitude = { signal = "A.c", valid = "Age < 150" }\n',
        encoding="utf-8",
    )
    nav = read_config(path).nav
    assert (nav.files, nav.separator, nav.columns["latitude"].column) == (["gps*.csv"], "auto", "Lat")
    assert (nav.can["latitude"].signal, nav.can["longitude"].valid) == ("A.b", "Age < 150")


def test_the_farthest_candidate_is_farther_than_the_nearest(tmp_path: Path) -> None:
    assert read(tmp_path, "[vehicle]\nwheelbase = 2.8\n[lookahead]\nminimum = 5.0\nmaximum = 5.0\n") == (
        "lookahead.maximum | lookahead.maximum: the farthest candidate must be farther than the nearest "
        "(lookahead.minimum), found 5.0"
    )


def test_a_threshold_is_a_number_or_goes_by_the_driver(tmp_path: Path) -> None:
    path = tmp_path / "wheelprint.toml"
    path.write_text(
        "[vehicle]\nwheelbase = 2.8\n[events]\nhard_braking = 4\nbrake_pressure = { quantile = 0.999 }\n",
        encoding="utf-8",
    )
    events = read_config(path).events
    assert (events.hard_braking.at_least, events.hard_braking.quantile) == (4.0, None)
    assert (events.brake_pressure.at_least, events.brake_pressure.quantile) == (0.0, 0.999)


def test_wrong_thresholds_are_named(tmp_path: Path) -> None:
    head = "[vehicle]\nwheelbase = 2.8\n[events]\n"
    assert read(
        tmp_path, head + "hard_braking = -1\nskid = { quantil = 0.9 }\nhard_cornering = { quantile = 1 }\n"
    ) == (
        "events.hard_braking.at_least, events.hard_cornering.quantile, events.skid.quantil | "
        "events.hard_braking.at_least: Input should be greater than or equal to 0, found -1; "
        "events.hard_cornering.quantile: Input should be less than 1, found 1; "
        "events.skid.quantil: unknown key; did you mean quantile?"
    )


def test_situations_differ(tmp_path: Path) -> None:
    message = read(tmp_path, '[vehicle]\nwheelbase = 2.8\n[situations]\nnames = ["a", "b", "a"]\n')
    assert message.startswith("situations.names | situations.names: named twice: a, found")


def test_an_embargo_shorter_than_the_longest_window_says_what_makes_it_long(tmp_path: Path) -> None:
    assert read(tmp_path, "[vehicle]\nwheelbase = 2.8\n[lookahead]\npoints = 80\n") == (
        "dataset.embargo | 6 s is shorter than the longest window, 8.5 s at 10 Hz, and training windows would share "
        "samples with test windows. models.motion_primitives takes 1 past and 50 future steps, lookahead.points looks "
        "80 ahead, the course deviation 1 back, and dataset.smoothing_window adds 4. Write 8.5 or more, or shorten "
        "these"
    )
    (tmp_path / "wheelprint.toml").write_text(
        "[vehicle]\nwheelbase = 2.8\n[dataset]\nembargo = 8.5\n[lookahead]\npoints = 80\n", encoding="utf-8"
    )
    assert read_config(tmp_path / "wheelprint.toml").longest_window == 85


def test_a_causal_window_may_be_even_and_a_bend_ends_below_where_it_begins(tmp_path: Path) -> None:
    path = tmp_path / "wheelprint.toml"
    path.write_text(
        '[vehicle]\nwheelbase = 2.8\n[dataset]\nsmoothing = "causal"\nsmoothing_window = 4\n', encoding="utf-8"
    )
    assert read_config(path).dataset.smoothing_window == 4
    assert read(tmp_path, "[vehicle]\nwheelbase = 2.8\n[segments]\nneutral = 0.04\nrelease = 0.05\n") == (
        "segments.release | segments.release: a bend cannot end above the course deviation that it begins with "
        "(segments.neutral), found 0.05"
    )
