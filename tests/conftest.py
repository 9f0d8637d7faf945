"""Settings of all tests: property tests draw the same examples in every run."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("wheelprint", derandomize=True, deadline=None, max_examples=60, database=None)
settings.load_profile("wheelprint")
