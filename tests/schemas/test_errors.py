from __future__ import annotations

import gc
from weakref import finalize

import numpy as np

from wheelprint.schemas.errors import InputError


def read(gone: list[str]) -> None:
    held = np.zeros(1)
    finalize(held, gone.append, "held")
    try:
        float("no number")
    except ValueError as error:
        raise InputError("can.log", "line 1", str(error)) from error


def test_a_problem_that_is_kept_holds_nothing_of_its_reader() -> None:
    gone: list[str] = []
    kept: list[InputError] = []
    try:
        read(gone)
    except InputError as error:
        kept.append(error.as_problem())
    gc.collect()
    assert gone == ["held"]
    assert [str(problem) for problem in kept] == ["can.log: line 1: could not convert string to float: 'no number'"]
