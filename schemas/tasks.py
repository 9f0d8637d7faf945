"""What a stage hands out to be run: independent, picklable, repeatable pieces of work."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from .errors import InputError


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a task leaves behind.

    Attributes:
        entry: What the manifest keeps: `outputs` and whatever else the stage says of them.
        problems: What was rejected, lost or could not be done; each is shown, and the command ends with status 3.
    """

    entry: Mapping[str, Any]
    problems: tuple[InputError, ...] = ()


@dataclass(frozen=True, slots=True)
class Task:
    """One piece of work: it publishes its files itself, may be repeated, and is run in any order and process.

    Attributes:
        section: Section of the manifest that its entry belongs to.
        name: Name of the entry within the section.
        run: A function of a module's top level; `InputError` from it fails this task alone.
        arguments: Picklable keyword arguments of `run`.
        fingerprint: Hash of all inputs and parameters; a task whose entry has the same one is not run again.
    """

    section: str
    name: str
    run: Callable[..., Outcome]
    arguments: Mapping[str, Any] = field(repr=False)
    fingerprint: str
