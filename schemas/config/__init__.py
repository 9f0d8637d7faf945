"""`wheelprint.toml`: what may stand in it, its defaults, and its validation; its tables by the stage they are for."""

from __future__ import annotations

from .dataset import Dataset, Events, Lookahead, Segments, Situations, Smoothing, Threshold
from .ingest import Can, CanSignal, DatabaseFile, Layout, Nav, NavSignal, Sync, TimeColumn, Vehicle
from .models import LookaheadModel, Models, MotionPrimitives, Personal
from .project_file import Config, read_config

__all__ = [
    "Can",
    "CanSignal",
    "Config",
    "DatabaseFile",
    "Dataset",
    "Events",
    "Layout",
    "Lookahead",
    "LookaheadModel",
    "Models",
    "MotionPrimitives",
    "Nav",
    "NavSignal",
    "Personal",
    "Segments",
    "Situations",
    "Smoothing",
    "Sync",
    "Threshold",
    "TimeColumn",
    "Vehicle",
    "read_config",
]
