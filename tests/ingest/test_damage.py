"""Damaged and cut files of every format; `benchmarks/damage.py` does the same with many more of each."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.ingest.damage import damage
from tests.ingest.sample_logs import SAMPLES
from wheelprint.ingest.readers import READERS

MUTATIONS, CUTS = 40, 20
OF_COSTLY = 2, 1


def test_every_format_is_here() -> None:
    named = {reader.format for reader in READERS} | {"dbc", "kcd", "sym", "arxml", "camera"}
    missing = {form for form in named if not any(name.startswith(form.partition("-")[0]) for name in SAMPLES)}
    assert not missing


@pytest.mark.parametrize("name", SAMPLES)
def test_damage_ends_as_a_result_or_an_input_error(name: str, tmp_path: Path) -> None:
    sample = SAMPLES[name]
    if sample.costly and find_spec("asammdf") is None:
        pytest.skip("asammdf is not installed (the extra mf4)")
    outcome = damage(name, sample, *(OF_COSTLY if sample.costly else (MUTATIONS, CUTS)), tmp_path)
    assert outcome.failures == []
    assert outcome.results + outcome.refusals == outcome.mutations + outcome.cuts
