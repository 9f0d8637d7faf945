"""What converting imports, in processes of their own."""

from __future__ import annotations

import json
import subprocess
import sys


def said_by(program: str) -> list[bool]:
    ran = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    answers: list[bool] = json.loads(ran.stdout)
    return answers


def test_cantools_comes_without_asammdf_which_can_be_imported_all_the_same() -> None:
    program = """
import json, sys
from wheelprint.ingest.memory import leave_out_asammdf
leave_out_asammdf()
here = ["cantools" in sys.modules, "asammdf" in sys.modules, "pandas" in sys.modules]
import asammdf
print(json.dumps([*here, hasattr(asammdf, "MDF")]))
"""
    assert said_by(program) == [True, False, False, True]


def test_what_is_imported_already_stays_as_it_is() -> None:
    program = """
import json, sys
import can.io.mf4
from wheelprint.ingest.memory import leave_out_asammdf
leave_out_asammdf()
print(json.dumps(["asammdf" in sys.modules, can.io.mf4.asammdf is not None]))
"""
    assert said_by(program) == [True, True]


def test_arrow_does_not_import_pandas_until_it_has_to_have_it() -> None:
    program = """
import json, sys
import pyarrow as pa
from wheelprint.ingest.memory import leave_out_pandas
leave_out_pandas()
table = pa.table({"a": pa.array([1, 2])})
here = "pandas" in sys.modules
frame = table.to_pandas()
again = pa.array(frame["a"]).to_pylist()
print(json.dumps([here, "pandas" in sys.modules, frame["a"].tolist() == [1, 2], again == [1, 2]]))
"""
    assert said_by(program) == [False, True, True, True]


def test_arrow_and_pandas_stay_together_where_they_are() -> None:
    program = """
import json
import pandas as pd
import pyarrow as pa
from wheelprint.ingest.memory import leave_out_pandas
leave_out_pandas()
table = pa.Table.from_pandas(pd.DataFrame({"a": [1]}))
print(json.dumps([pa.array(pd.Series([1, 2])).to_pylist() == [1, 2], table.num_rows == 1]))
"""
    assert said_by(program) == [True, True]


def test_numba_looks_for_scipy_only_where_matrices_are_multiplied() -> None:
    program = """
import json, sys
import numpy as np
from numba import njit
from wheelprint.ingest.memory import leave_out_scipy
leave_out_scipy()
total = njit(lambda x: x.sum())(np.ones(3))
here = "scipy.linalg" in sys.modules
product = njit(lambda x: np.dot(x, x))(np.eye(2))
print(json.dumps([total == 3.0, here, bool((product == np.eye(2)).all()), "scipy.linalg" in sys.modules]))
"""
    assert said_by(program) == [True, False, True, True]


def test_scipy_stays_where_it_is() -> None:
    program = """
import json
import scipy.linalg
from wheelprint.ingest.memory import leave_out_scipy
leave_out_scipy()
import scipy.linalg as again
print(json.dumps([again is scipy.linalg]))
"""
    assert said_by(program) == [True]
