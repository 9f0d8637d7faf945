"""The project file as a whole, and its validation at the edge."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from pydantic import ValidationError

from ..errors import InputError
from .dataset import Dataset, Events, Lookahead, Segments, Situations
from .ingest import Can, Layout, Nav, Sync, Vehicle
from .models import Models
from .section import Section


class Config(Section):
    """The whole project file."""

    vehicle: Vehicle
    layout: Layout = Layout()
    can: Can = Can()
    nav: Nav = Nav()
    sync: Sync = Sync()
    events: Events = Events()
    situations: Situations = Situations()
    dataset: Dataset = Dataset()
    lookahead: Lookahead = Lookahead()
    segments: Segments = Segments()
    models: Models = Models()

    @property
    def longest_window(self) -> int:
        """Steps from the first to the last raw sample that a window of any model, or what it is to predict, rests on.

        A motion primitive reaches from its past to its future steps, a lookahead distance to the last path point ahead.
        Behind that lies the sample that the course deviation, or a lag undone, takes; smoothing adds its own window.
        """
        primitives, personal = self.models.motion_primitives, self.models.personal
        ahead = max(
            max(*primitives.past_steps, 0) + primitives.future_steps,
            max(personal.past_steps, 0) + personal.future_steps if personal.evaluate else 0,
            self.lookahead.points,
        )
        return self._steps_back + ahead + self.dataset.smoothing_window - 1

    @property
    def _steps_back(self) -> int:
        return max(1, round(1e8 / self.sync.period)) if self.lookahead.definition == "refined" else 1


def read_config(path: Path) -> Config:
    """Read and validate a project file.

    Raises:
        InputError: The file is missing, is not TOML, or holds keys or values that are not allowed; every such key
            is named in one message.
    """
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        reason = "no such file. A project is a folder with this file; `wheelprint init` writes one"
        raise InputError(path, "", reason) from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte {error.start}", "not UTF-8; save the file as UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, "", f"not TOML: {error}") from None
    try:
        config = Config.model_validate(raw)
    except ValidationError as error:
        lines = [_complaint(item["loc"], item["type"], item["msg"], item.get("input")) for item in error.errors()]
        keys = ", ".join(dict.fromkeys(line.split(":", 1)[0] for line in lines))
        raise InputError(path, keys, "; ".join(dict.fromkeys(lines))) from None
    longest = config.longest_window * config.sync.period / 1e9
    if config.dataset.embargo < longest:
        raise InputError(path, "dataset.embargo", _short_embargo(config, longest))
    return config


def _short_embargo(config: Config, longest: float) -> str:
    primitives = config.models.motion_primitives
    past, future = max(*primitives.past_steps, 0), primitives.future_steps
    personal = max(config.models.personal.past_steps, 0), config.models.personal.future_steps
    longer = config.models.personal.evaluate and sum(personal) > past + future
    also = f"models.personal {personal[0]} and {personal[1]}, " if longer else ""
    return (
        f"{config.dataset.embargo:g} s is shorter than the longest window, {longest:g} s at {config.sync.rate:g} Hz, "
        f"and training windows would share samples with test windows. models.motion_primitives takes {past} past and "
        f"{future} future steps, {also}lookahead.points looks {config.lookahead.points} ahead, the course deviation 1 "
        f"back, and dataset.smoothing_window adds {config.dataset.smoothing_window - 1}. Write {longest:g} or more, or "
        "shorten these"
    )


def _complaint(location: tuple[int | str, ...], kind: str, message: str, found: Any) -> str:
    key = ".".join(
        str(part) for part in location if not str(part).startswith(("literal[", "constrained-", "function-"))
    )
    if kind == "missing":
        return f"{key}: missing; it has no default"
    if kind == "extra_forbidden":
        section: Any = Config
        for part in location[:-1]:
            if hasattr(section, "model_fields"):
                section = section.model_fields[part].annotation
            else:  # an element of a list or table
                *_, section = get_args(section) or (None,)
                section = get_args(section)[0] if get_origin(section) is Annotated else section
        known = list(section.model_fields) if hasattr(section, "model_fields") else []
        near = difflib.get_close_matches(str(location[-1]), known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    return f"{key}: {message.removeprefix('Value error, ')}, found {found!r}"
