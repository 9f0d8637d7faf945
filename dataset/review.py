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

import pyarrow as pa

from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import read_table
from ..schemas.times import iso_utc
from .event_plots import PANELS, plot
from .events import Event, read_events, write_events

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

ADDRESS = "127.0.0.1"


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
        text = page.render(nonce=nonce, state=state, person=person, cards=list(_cards(project, events)))
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
            "start": iso_utc(event.start).replace("T", " ").removesuffix("Z"),
            "seconds": (event.stop - event.start) / 1e9,
            "plots": [] if table is None else [plot(panel, table, event) for panel in PANELS],
        }


def _synced(project: Project, recording: str) -> pa.Table | None:
    driver, _, name = recording.partition("/")
    path = project.synced_file(driver, name)
    return read_table(path) if path.is_file() else None
