"""Wheelprint: raw vehicle logs in, personalised driver models out."""

__version__ = "0.1.0"
