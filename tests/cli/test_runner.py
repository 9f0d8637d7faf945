"""Tasks on a cluster of processes and in this one: none is lost or done twice when the user stops them."""

from __future__ import annotations

import io
import signal
import time
from pathlib import Path

import pytest
from rich.console import Console

from wheelprint import runner
from wheelprint.runner import Workers, patient_interrupts, run_stage
from wheelprint.schemas.store import Manifest
from wheelprint.schemas.tasks import Outcome, Task

TASKS = 24


def work(folder: Path, name: str) -> Outcome:
    """Leave a file of each time that the task was done."""
    with (folder / name).open("a", encoding="utf-8") as file:
        file.write("done\n")
    time.sleep(0.01)
    return Outcome({"outputs": []})


def tasks(folder: Path) -> list[Task]:
    names = [f"{number:02}" for number in range(TASKS)]
    return [Task("work", name, work, {"folder": folder, "name": name}, "same") for name in names]


@pytest.mark.parametrize("count", [1, 2])
def test_an_interrupted_stage_records_what_it_began_and_goes_on_from_there(tmp_path: Path, count: int) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    said = io.StringIO()
    console = Console(file=said, width=120)
    manifest = Manifest(tmp_path)
    with Workers(count) as workers:
        with patient_interrupts(console) as stopped:

            def interrupt_once() -> bool:
                if len(list(folder.iterdir())) > 5 and not stopped():
                    signal.raise_signal(signal.SIGINT)
                    signal.raise_signal(signal.SIGINT)  # As `timeout` does.
                return stopped()

            first = run_stage(
                "work", tasks(folder), [], manifest, workers, console, force=False, stopped=interrupt_once
            )
        assert sorted(first.done) == sorted(file.name for file in folder.iterdir())
        assert 5 < len(first.done) < TASKS
        assert said.getvalue() == "Stopping when what is at work now is done; Ctrl-C again stops at once.\n"
        second = run_stage("work", tasks(folder), [], manifest, workers, console, force=False)
    assert sorted(second.current) == sorted(first.done)
    assert {file.read_text(encoding="utf-8") for file in folder.iterdir()} == {"done\n"}
    assert len(first.done) + len(second.done) == TASKS


def test_processes_that_were_ended_begin_anew(tmp_path: Path) -> None:
    with Workers(2) as workers:
        for number in (1, 2):
            folder = tmp_path / f"{number}"
            folder.mkdir()
            ended = [task.name for task, _ in workers.run(tasks(folder), lambda: False)]
            assert sorted(ended) == sorted(file.name for file in folder.iterdir())
            workers.close()


def test_a_second_interrupt_stops_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "IMPATIENCE", -1.0)
    before = signal.getsignal(signal.SIGINT)
    with patient_interrupts(Console(file=io.StringIO())) as stopped:
        signal.raise_signal(signal.SIGINT)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
