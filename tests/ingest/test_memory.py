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
