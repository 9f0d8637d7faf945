"""The review page: proposed events beside what the car did, and two buttons that decide; on this machine only."""

from __future__ import annotations

import getpass
import hashlib
import os
import secrets
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import read_table
from .events import Event, format_stamp, read_events, write_events

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

ADDRESS = "127.0.0.1"
CONTEXT = 8.0
"""s shown before and after an event."""
LONGEST_TRACE = 1200
"""Samples of a line; of a longer one every second, third, … is drawn."""

_Style = Literal["solid", "dashed"]


@dataclass(frozen=True, slots=True)
class _Panel:
    """What one small plot shows.

    Attributes:
        title: Name of the quantity.
        unit: Unit of the axis.
        factor: From the stored unit to that of the axis.
        least: Range of the axis that is always shown, so that noise does not look like an event.
        lines: Name, style and columns of each line; the first column that holds anything is drawn.
    """

    title: str
    unit: str
    factor: float
    least: tuple[float, float]
    lines: tuple[tuple[str, _Style, tuple[str, ...]], ...]


_PANELS = (
    _Panel("Speed", "km/h", 3.6, (0, 20), (("", "solid", ("nav_speed", "speed")),)),
    _Panel(
        "Acceleration",
        "m/s²",
        1.0,
        (-4, 4),
        (
            ("longitudinal", "solid", ("longitudinal_acceleration", "nav_longitudinal_acceleration")),
            ("lateral", "dashed", ("lateral_acceleration", "nav_lateral_acceleration")),
        ),
    ),
    _Panel("Steering wheel angle", "°, positive left", 1.0, (-45, 45), (("", "solid", ("steering_wheel_angle",)),)),
)


def create_app(project: Project, token: str, *, reviewer: str | None = None) -> Starlette:
    """Return the application that shows `events.csv` and stores decisions in it.

    Args:
        project: Whose events are shown; the lines come from its synced tables.
        token: First part of every address; without it nothing is answered.
        reviewer: Name stored with each decision; by default the user name on this machine.
    """
    from starlette.applications import Starlette
    from starlette.exceptions import HTTPException
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware
    from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse
    from starlette.routing import Route

    person = reviewer or _user_name()
    page = _template()

    def check(request: Request) -> None:
        if not secrets.compare_digest(request.path_params["token"].encode(), token.encode()):
            raise HTTPException(404)

    def show(request: Request) -> Response:
        check(request)
        state = _state_of(project.events_file)
        events = read_events(project.events_file)
        nonce = secrets.token_urlsafe(16)
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        text = page.render(
            nonce=nonce, state=state, person=person, cards=list(_cards(project, events)), context=CONTEXT
        )
        return HTMLResponse(text, headers={"content-security-policy": policy, **_HEADERS})

    async def decide(request: Request) -> Response:
        check(request)
        wish = _Wish.parse(await request.body())
        if wish is None:
            return PlainTextResponse('expected {"state": "…", "event": 0, "decision": "emergency" or "normal"}', 400)
        # Nothing is awaited from here on, so that no other decision comes between reading and writing.
        if wish.state != _state_of(project.events_file):
            return PlainTextResponse("events.csv has changed since the page was loaded", 409)
        events = read_events(project.events_file)
        if not 0 <= wish.event < len(events):
            return PlainTextResponse(f"there are {len(events)} events, not one of number {wish.event}", 400)
        events[wish.event] = replace(events[wish.event], decision=wish.decision, decided_by=person)
        write_events(project.events_file, events)
        content = {"state": _state_of(project.events_file), "decision": wish.decision, "decided_by": person}
        return JSONResponse(content, headers=_HEADERS)

    def explain(_request: Request, error: Exception) -> Response:
        return PlainTextResponse(str(error), 422, headers=_HEADERS)

    return Starlette(
        routes=[Route("/{token}/", show), Route("/{token}/decisions", decide, methods=["POST"])],
        # A foreign page whose name is made to point here still sends its own name as Host.
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=[ADDRESS, "localhost"], www_redirect=False)],
        exception_handlers={InputError: explain},
    )


def serve(
    project: Project,
    port: int = 0,
    *,
    reviewer: str | None = None,
    announce: Callable[[str], None] | None = None,
) -> None:
    """Serve the review page on 127.0.0.1 until the process is interrupted (Ctrl-C), which is its ordinary end.

    Args:
        project: Whose events are reviewed.
        port: TCP port; 0 takes any free one.
        reviewer: Name stored with each decision; by default the user name on this machine.
        announce: Called with the address, its secret token included, once the page can be opened; by default it is
            printed.

    Raises:
        InputError: `events.csv` is wrong, or the port cannot be used.
    """
    import socket

    import uvicorn

    read_events(project.events_file)
    token = secrets.token_urlsafe(24)
    app = create_app(project, token, reviewer=reviewer)
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((ADDRESS, port))
        except OSError as error:
            reason = f"cannot listen on {ADDRESS}: {error.strerror}; take another port, or 0 for any free one"
            raise InputError(project.directory, f"port {port}", reason) from None
        listener.listen()
        # The access log would hold the token.
        settings = uvicorn.Config(
            app, log_level="warning", access_log=False, lifespan="off", ws="none", server_header=False
        )
        (announce or _print_address)(f"http://{ADDRESS}:{listener.getsockname()[1]}/{token}/")
        with suppress(KeyboardInterrupt):
            uvicorn.Server(settings).run(sockets=[listener])


def _print_address(address: str) -> None:
    sys.stdout.write(f"The review page is at {address}\nCtrl-C ends it.\n")
    sys.stdout.flush()


_HEADERS = {"cache-control": "no-store", "referrer-policy": "no-referrer", "x-content-type-options": "nosniff"}


@dataclass(frozen=True, slots=True)
class _Wish:
    """A decision as the page sends it: which event of which state of the file, and what it is."""

    state: str
    event: int
    decision: Literal["emergency", "normal"]

    @classmethod
    def parse(cls, body: bytes) -> _Wish | None:
        import json

        try:
            content = json.loads(body)
        except ValueError:
            return None
        match content:
            case {"state": str(state), "event": int(event), "decision": "emergency" | "normal" as decision}:
                return cls(state, event, decision)
        return None


def _user_name() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return f"user {os.getuid()}"


def _state_of(path: Path) -> str:
    """Return a hash of the file's content, or of nothing where there is no file."""
    return hashlib.sha256(path.read_bytes() if path.exists() else b"").hexdigest()


def _template() -> Any:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string((files(__package__) / "review.html").read_text(encoding="utf-8"))


def _cards(project: Project, events: Sequence[Event]) -> Iterator[dict[str, Any]]:
    """Yield what the page shows of each event; events are sorted, so each recording is read once."""
    table: pa.Table | None = None
    recording = ""
    for event in events:
        if event.recording != recording:
            recording = event.recording
            table = _synced(project, recording)
        yield {
            "event": event,
            "start": format_stamp(event.start).replace("T", " ").removesuffix("Z"),
            "seconds": (event.stop - event.start) / 1e9,
            "plots": [] if table is None else [plot(panel, table, event) for panel in _PANELS],
        }


def _synced(project: Project, recording: str) -> pa.Table | None:
    driver, _, name = recording.partition("/")
    path = project.synced_file(driver, name)
    return read_table(path) if path.is_file() else None


@dataclass(frozen=True, slots=True)
class Plot:
    """A small plot in the coordinates of its drawing.

    Attributes:
        title: Name of the quantity.
        unit: Unit of the vertical axis.
        lines: Name, style and SVG path of each line.
        marks_x: Position and label of the marks of the time axis, s from the event's start.
        marks_y: Position and label of the marks of the vertical axis.
        start: Left edge of the event.
        stop: Right edge of the event.
    """

    title: str
    unit: str
    lines: list[tuple[str, _Style, str]]
    marks_x: list[tuple[float, str]]
    marks_y: list[tuple[float, str]]
    start: float
    stop: float


LEFT, RIGHT, TOP, BOTTOM = 46.0, 392.0, 8.0, 122.0


def plot(panel: _Panel, table: pa.Table, event: Event) -> Plot:
    """Draw one panel around an event.

    Args:
        panel: What to draw.
        table: Synced table of the event's recording.
        event: What to draw around; `CONTEXT` seconds before and after it are shown.
    """
    time = table["time"].cast(pa.int64()).to_numpy()
    margin = round(CONTEXT * 1e9)
    rows = slice(*np.searchsorted(time, (event.start - margin, event.stop + margin)))
    step = -(-(rows.stop - rows.start) // LONGEST_TRACE) or 1
    rows = slice(rows.start, rows.stop, step)
    seconds = (time[rows] - event.start) / 1e9
    run = table["run"].to_numpy(zero_copy_only=False)[rows].astype(float)
    broken = np.isnan(run) | (np.diff(run, prepend=np.nan) != 0)
    lines = [(name, style, _first(table, columns, rows) * panel.factor) for name, style, columns in panel.lines]

    begin, end = -CONTEXT, (event.stop - event.start) / 1e9 + CONTEXT
    drawn = np.concatenate([values for _, _, values in lines])
    finite = drawn[np.isfinite(drawn)]
    low, high = (float(function((*panel.least, *finite))) for function in (min, max))

    def x(value: Any) -> Any:
        return LEFT + (RIGHT - LEFT) * (value - begin) / (end - begin)

    def y(value: Any) -> Any:
        return BOTTOM - (BOTTOM - TOP) * (value - low) / (high - low)

    return Plot(
        panel.title,
        panel.unit,
        [(name, style, _path(x(seconds), y(values), broken)) for name, style, values in lines],
        [(float(x(mark)), f"{mark:g}") for mark in _marks(begin, end, 8)],
        [(float(y(mark)), f"{mark:g}") for mark in _marks(low, high, 4)],
        float(x(0.0)),
        float(x(end - CONTEXT)),
    )


def _first(table: pa.Table, columns: Sequence[str], rows: slice) -> NDArray[np.float64]:
    """Return the first of the columns that holds anything in these rows, NaN where it is null."""
    for column in columns:
        values: NDArray[np.float64] = table[column].to_numpy(zero_copy_only=False)[rows].astype(np.float64)
        if np.isfinite(values).any():
            return values
    return np.full(len(range(*rows.indices(len(table)))), np.nan)


def _path(x: NDArray[np.float64], y: NDArray[np.float64], broken: NDArray[np.bool_]) -> str:
    """Return an SVG path that breaks where a value is missing and where a run begins."""
    parts = []
    pen_down = False
    for px, py, breaks in zip(x.tolist(), y.tolist(), broken.tolist(), strict=True):
        if py != py:  # noqa: PLR0124  NaN
            pen_down = False
            continue
        parts.append(f"{'L' if pen_down and not breaks else 'M'}{px:.1f} {py:.1f}")
        pen_down = True
    return "".join(parts)


def _marks(low: float, high: float, at_most: int) -> list[float]:
    """Return the multiples of 1, 2 or 5 times a power of ten within [low, high], at most so many."""
    step = 10.0 ** np.floor(np.log10((high - low) / at_most))
    step = next(step * nice for nice in (1, 2, 5, 10) if (high - low) / (step * nice) <= at_most - 1 or nice == 10)
    return [round(number * step, 9) + 0.0 for number in range(int(np.ceil(low / step)), int(high // step) + 1)]
