"""Runs the tasks of a stage: here, or on a Dask cluster of local processes."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any, Self

from .schemas.errors import InputError
from .schemas.tasks import Outcome, Task

if TYPE_CHECKING:
    from rich.console import Console

    from .schemas.store import Manifest

BACKLOG = 2
"""Tasks that a worker has, at most: the one it works on and the next, so that it never waits for this process."""
IMPATIENCE = 1.0
"""s, after which another interrupt is a second one: some programs pass one on twice."""


@dataclass(slots=True)
class StageResult:
    """What a stage did.

    Attributes:
        done: Names of the entries made now.
        current: Names of the entries that were already made from the same inputs and parameters.
        failed: Names of the entries that could not be made.
        problems: All that was rejected, lost or failed, those of current entries too.
        seconds: How long it took, planning aside.
    """

    done: list[str] = field(default_factory=list)
    current: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    problems: list[InputError] = field(default_factory=list)
    seconds: float = 0.0


class Workers:
    """Where tasks run: in this process, or on a Dask cluster of local processes that starts when it is first needed.

    Dask, because it repeats the tasks of a worker that was killed, where a pool of processes loses them.

    Args:
        count: Processes; 1 runs everything in this one.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._open = ExitStack()
        self._client: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the processes and what they hold; the next tasks get new ones."""
        self._open.close()
        self._client = None

    def run(self, tasks: Sequence[Task], stopped: Callable[[], bool]) -> Iterator[tuple[Task, Outcome | InputError]]:
        """Yield each task with what came of it, in the order in which they end.

        Args:
            tasks: What there is to do.
            stopped: No task is begun any more once this tells so; those at work are finished.
        """
        if min(self._count, len(tasks)) <= 1:
            for task in tasks:
                if stopped():
                    return
                yield task, _attempt(task)
            return
        import dask
        from distributed import Client, LocalCluster, as_completed

        if self._client is None:
            of_workers = "distributed.nanny.pre-spawn-environ."
            settings = {
                # Dask makes malloc give every freed array back to the system, and so keeps it from learning how large
                # arrays are: each of 128 KiB or more would be new memory, cleared page by page, a sixth of all work.
                # More than 64 MiB that are free go back: workers seldom need the most at the same time.
                f"{of_workers}MALLOC_TRIM_THRESHOLD_": 1 << 26,
                f"{of_workers}MALLOC_MMAP_THRESHOLD_": 1 << 25,
                # A worker that is told to stop has nothing to say.
                f"{of_workers}DASK_LOGGING": str(dict.fromkeys(("distributed", "distributed.worker"), "critical")),
            }
            self._open.enter_context(dask.config.set(settings))
            logging.getLogger("distributed").setLevel(logging.ERROR)
            with _deaf_to_interrupts():
                cluster = self._open.enter_context(
                    LocalCluster(
                        n_workers=self._count, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
                    )
                )
            self._client = self._open.enter_context(Client(cluster))
        waiting = iter(tasks)
        at_work = {
            self._client.submit(_attempt, task, pure=False): task for task in islice(waiting, BACKLOG * self._count)
        }
        ended = as_completed(at_work)
        for future in ended:
            task = at_work.pop(future)
            if not stopped() and (following := next(waiting, None)):
                begun = self._client.submit(_attempt, following, pure=False)
                at_work[begun] = following
                ended.add(begun)
            yield task, future.result()


def run_stage(
    title: str,
    tasks: Sequence[Task],
    planning: Sequence[InputError],
    manifest: Manifest,
    workers: Workers,
    console: Console,
    *,
    force: bool,
    stopped: Callable[[], bool] = lambda: False,
) -> StageResult:
    """Run what is not current, record each outcome in the manifest as it comes, and show the progress.

    Args:
        title: What the progress bar says.
        tasks: The stage's tasks.
        planning: Problems that were met while they were planned.
        manifest: Where outcomes are recorded; problems that belong to no outcome are in its section `stages`.
        workers: Where the tasks run.
        console: Where the progress goes; nothing is shown where it is not a terminal.
        force: Run current tasks too.
        stopped: No task is begun any more once this tells so.
    """
    begin = time.monotonic()
    result = StageResult(problems=[*planning])
    homeless = [*planning]
    waiting: list[Task] = []
    for task in tasks:
        if not force and manifest.is_current(task.section, task.name, task.fingerprint):
            result.current.append(task.name)
            stored = manifest.entry(task.section, task.name).get("problems", ())
            result.problems += [InputError(p["path"], p["where"], p["reason"]) for p in stored]
        else:
            waiting.append(task)
    with _progress(console, title, len(waiting)) as advance:
        for task, outcome in workers.run(waiting, stopped):
            if isinstance(outcome, InputError):
                result.failed.append(task.name)
                result.problems.append(outcome)
                homeless.append(outcome)
                manifest.remove(task.section, task.name)
            else:
                result.done.append(task.name)
                result.problems += outcome.problems
                entry = {**outcome.entry, "fingerprint": task.fingerprint, "problems": _records(outcome.problems)}
                manifest.record(task.section, task.name, entry)
            advance()
    manifest.record("stages", title, {"outputs": [], "problems": _records(homeless)})
    result.seconds = time.monotonic() - begin
    return result


def _records(problems: Sequence[InputError]) -> list[dict[str, str]]:
    return [{"path": problem.path, "where": problem.where, "reason": problem.reason} for problem in problems]


@contextmanager
def patient_interrupts(console: Console) -> Iterator[Callable[[], bool]]:
    """Let a first Ctrl-C wait for the tasks at work, whose results would be lost otherwise; a second one does not.

    Args:
        console: Where the user is told so.

    Yields:
        Tells whether there was one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    interrupted_at: list[float] = []

    def interrupted(number: int, frame: Any) -> None:
        interrupted_at.append(time.monotonic())
        if len(interrupted_at) == 1:
            console.print("Stopping when what is at work now is done; Ctrl-C again stops at once.")
        elif interrupted_at[-1] - interrupted_at[0] > IMPATIENCE:
            signal.default_int_handler(number, frame)

    before = signal.signal(signal.SIGINT, interrupted)
    try:
        yield lambda: bool(interrupted_at)
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let processes that start meanwhile ignore Ctrl-C, which reaches all of a terminal: this one ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _attempt(task: Task) -> Outcome | InputError:
    from .ingest.memory import leave_out_pandas

    leave_out_pandas()  # Arrow imports it else, with no use to any task.
    try:
        return task.run(**task.arguments)
    except InputError as error:
        return error.as_problem()


@contextmanager
def _progress(console: Console, title: str, total: int) -> Iterator[Any]:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    times = (TimeElapsedColumn(), TimeRemainingColumn())
    columns = (TextColumn("{task.description:<10}"), BarColumn(), MofNCompleteColumn(), *times)
    with Progress(*columns, console=console, disable=not console.is_terminal or total == 0, transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda: bar.advance(task)


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))
