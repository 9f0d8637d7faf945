"""Stamps as people and CSV files read them."""

from __future__ import annotations

from datetime import UTC, datetime


def iso_utc(time: int) -> str:
    """Return ns since 1970 as ISO 8601 UTC with milliseconds, rounded down: `2026-11-23T08:00:00.100Z`."""
    seconds, rest = divmod(time, 1_000_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest // 1_000_000:03d}Z"
