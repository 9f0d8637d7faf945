"""The local server of the review page: who is let in, what is answered, how it starts and ends."""

from __future__ import annotations

import os
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib.resources import files
from typing import Any

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...schemas.errors import InputError
from ...schemas.project import Project, Recording
from ..detectors import emergency_detectors
from .changes import ADDED, MS, Refusal, Wish, as_json, books_of, fulfil, user_name
from .ledger import Conflict
from .pictures import MEDIA_TYPES, Camera, cameras_of
from .signals import PANELS, Drive, Drives

ADDRESS = "127.0.0.1"
LONGEST_WISH = 20_000
"""bytes of a request that asks for a change."""

PAGE_FILES = {
    "": ("page.html", "text/html"),
    "style.css": ("style.css", "text/css"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
    **{f"{name}.js": (f"{name}.js", "text/javascript") for name in "main outbox plots map dialogs elements".split()},
}
"""What the page consists of: address behind the token, file of this folder, media type."""

HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'"
    ),
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
"""Of every answer. No string becomes an element or a script, nothing comes from elsewhere, nobody frames the page."""


def create_app(project: Project, token: str, *, reviewer: str | None = None) -> Starlette:
    """Return the application that shows `events.csv` and `situations.csv` and stores decisions in them.

    Args:
        project: Whose events are shown; what the car did comes from its synced tables.
        token: First part of every address; without it nothing is answered.
        reviewer: Name stored with each decision; by default the page asks for it.
    """
    desk = _Desk(project, reviewer)

    def explain(_request: Request, error: Exception) -> Response:
        return PlainTextResponse(str(error), 422)

    routes = [
        Route("/{token}/project", desk.project_facts),
        Route("/{token}/lists", desk.lists),
        Route("/{token}/changes", desk.change, methods=["POST"]),
        Route("/{token}/recordings/{recording:int}/outline", desk.outline),
        Route("/{token}/recordings/{recording:int}/window", desk.window),
        Route("/{token}/recordings/{recording:int}/frames/{camera:int}/{frame:int}", desk.frame),
        *(Route(f"/{{token}}/{address}", partial(_page_file, address)) for address in PAGE_FILES),
    ]
    return Starlette(
        routes=routes,
        middleware=[
            Middleware(_Door, token=token),
            # A foreign page whose name is made to point here still sends its own name as Host.
            Middleware(TrustedHostMiddleware, allowed_hosts=[ADDRESS, "localhost"], www_redirect=False),
        ],
        exception_handlers={InputError: explain, OSError: explain},
    )


def serve(
    project: Project,
    port: int = 0,
    *,
    reviewer: str | None = None,
    browser: bool = False,
    announce: Callable[[str], None] | None = None,
) -> None:
    """Serve the review page on 127.0.0.1 until the process is interrupted (Ctrl-C), which is its ordinary end.

    Args:
        project: Whose events are reviewed.
        port: TCP port; 0 takes any free one.
        reviewer: Name stored with each decision; by default the page asks for it.
        browser: Open the page in this machine's browser, if it has a screen.
        announce: Called with the address, its secret token included, once the page can be opened; by default it is
            printed.

    Raises:
        InputError: `events.csv` or `situations.csv` is wrong, or the port cannot be used.
    """
    import uvicorn

    for book in books_of(project).values():
        book.ledger.rows()
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
        # The access log would hold the token. A page that keeps its connection open does not hold up the end.
        settings = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            lifespan="off",
            ws="none",
            server_header=False,
            timeout_graceful_shutdown=2,
        )
        address = f"http://{ADDRESS}:{listener.getsockname()[1]}/{token}/"
        (announce or print_address)(address)
        # Without a screen, Python would start a browser in the terminal.
        if browser and (sys.platform == "darwin" or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
            webbrowser.open(address)
        with suppress(KeyboardInterrupt):
            uvicorn.Server(settings).run(sockets=[listener])


def print_address(address: str) -> None:
    """Print where the page is and how it ends."""
    sys.stdout.write(f"The review page is at {address}\nCtrl-C ends it.\n")
    sys.stdout.flush()


class _Door:
    """Answers nothing without the token, and gives every answer its headers."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self.app = app
        self.token = token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        given = scope["path"].split("/")[1]
        is_guest = scope["type"] == "http" and secrets.compare_digest(given.encode(), self.token)
        app = self.app if is_guest else PlainTextResponse("Not Found", 404)
        await app(scope, receive, send_with_headers)


def _page_file(address: str, _request: Request) -> Response:

    name, media_type = PAGE_FILES[address]
    return Response((files(__package__) / name).read_bytes(), media_type=media_type)


class _Desk:
    """What the addresses of the page answer.

    Recordings are known by numbers, which stay while the process lives; no name or path is ever asked for.
    """

    def __init__(self, project: Project, reviewer: str | None) -> None:
        self.project = project
        self.reviewer = reviewer
        self.books = books_of(project)
        self.drives = Drives()
        self.folders: dict[str, Recording] = {}
        with suppress(InputError):  # Of a project without raw logs the lists can still be looked at.
            self.folders = {recording.key: recording for recording in project.recordings()}
        self.recordings = list(self.folders)
        self._lock = threading.Lock()
        self._cameras = cache(partial(cameras_of, project))

    def project_facts(self, _request: Request) -> Response:
        """What stays while the page is open."""
        limits: dict[str, list[float]] = {}
        for detector in emergency_detectors(self.project.config.events):
            signs = (1, -1) if detector.sign == 0 else (detector.sign,)
            limits.setdefault(detector.signal, []).extend(sign * detector.threshold for sign in signs)
        panels = [
            {
                "title": panel.title,
                "unit": panel.unit,
                "factor": panel.factor,
                "least": panel.least,
                "lines": [{"column": column, "name": name} for column, name in panel.lines],
                "limits": sorted(
                    {limit * panel.factor for column, _ in panel.lines for limit in limits.get(column, ())}
                ),
            }
            for panel in PANELS
        ]
        return JSONResponse(
            {
                "name": self.project.directory.name,
                "reviewer": self.reviewer,
                "user": user_name(),
                "panels": panels,
                "situations": self.project.config.situations.names,
            }
        )

    def lists(self, request: Request) -> Response:
        """All rows of both lists, or 204 while they are in the state that the page knows (`since`)."""
        books = {name: book.ledger.rows() for name, book in self.books.items()}
        state = "-".join(state for state, _ in books.values())
        if state == request.query_params.get("since"):
            return Response(status_code=204)
        content: dict[str, Any] = {
            name: [self._row(self.books[name], number, row) for number, row in rows.items()]
            for name, (_, rows) in books.items()
        }
        return JSONResponse({"state": state, "recordings": self.recordings, **content})

    async def change(self, request: Request) -> Response:
        """One change of one row: 200 and the row, 409 and what it is now, 400 and why not."""
        if request.headers.get("content-type") != "application/json":
            return PlainTextResponse("expected application/json", 415)
        if int(request.headers.get("content-length", LONGEST_WISH + 1)) > LONGEST_WISH:
            return PlainTextResponse("too long", 413)
        try:
            wish = Wish.model_validate_json(await request.body())
        except ValidationError as error:
            return PlainTextResponse(
                "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()), 400
            )
        book = self.books[wish.book]
        labels = [ADDED] if wish.book == "events" else self.project.config.situations.names
        try:
            change = await run_in_threadpool(fulfil, wish, book, self.recordings, labels)
        except Refusal as refusal:
            return PlainTextResponse(str(refusal), 400)
        except Conflict as conflict:
            return JSONResponse(
                {"number": conflict.number, "row": self._row(book, conflict.number, conflict.current)}, 409
            )
        return JSONResponse({"number": change.number, "row": self._row(book, change.number, change.after)})

    def outline(self, request: Request) -> Response:
        """The whole recording in few points."""
        _, drive = self._drive(request)
        return JSONResponse(None if drive is None else drive.outline())

    def window(self, request: Request) -> Response:
        """Signals and frames within `start` and `stop`, ms UTC."""
        recording, drive = self._drive(request)
        try:
            start, stop = (int(request.query_params[edge]) * MS for edge in ("start", "stop"))
        except (KeyError, ValueError):
            raise HTTPException(400, "expected start and stop, ms UTC") from None
        if not 0 <= start < stop < 2**63:
            raise HTTPException(400, "expected a stop after the start")
        problem = ""
        try:
            cameras = self._cameras_of(recording)
        except InputError as error:  # The signals are worth seeing all the same.
            cameras, problem = [], str(error)
        return JSONResponse(
            {
                "signals": None if drive is None else drive.window(start, stop),
                "cameras": [camera.within(start, stop) for camera in cameras],
                "problem": problem,
            }
        )

    def frame(self, request: Request) -> Response:
        """One image."""
        cameras = self._cameras_of(self._name(request))
        number, frame = request.path_params["camera"], request.path_params["frame"]
        file = cameras[number].file(frame) if number < len(cameras) else None
        if file is None:
            raise HTTPException(404)
        return FileResponse(
            file, media_type=MEDIA_TYPES[file.suffix.lower()], headers={"cache-control": "private, max-age=3600"}
        )

    def _number_of(self, name: str) -> int:
        """Return the number of a recording; one that only the lists know gets one."""
        with self._lock:
            if name not in self.recordings:
                self.recordings.append(name)
            return self.recordings.index(name)

    def _name(self, request: Request) -> str:
        number: int = request.path_params["recording"]
        if number >= len(self.recordings):
            raise HTTPException(404)
        return self.recordings[number]

    def _drive(self, request: Request) -> tuple[str, Drive | None]:
        name = self._name(request)
        driver, _, recording = name.partition("/")
        return name, self.drives.get(self.project.synced_file(driver, recording))

    def _cameras_of(self, name: str) -> list[Camera]:
        return self._cameras(self.folders[name]) if name in self.folders else []

    def _row(self, book: Any, number: int, row: Any) -> dict[str, Any] | None:
        return None if row is None else as_json(number, row, book, self._number_of(row.recording))
