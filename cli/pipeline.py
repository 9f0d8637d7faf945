"""The stages in their order, as commands run them: plan, run, record, say what came of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

from .output import Report, console
from .runner import Workers, available_cores, patient_interrupts, run_stage
from .schemas.errors import InputError
from .schemas.store import Manifest

if TYPE_CHECKING:
    from .modeling.experiments import Experiment
    from .schemas.project import Project
    from .schemas.tasks import Task


class Pipeline:
    """The stages of one project.

    Args:
        project: The project.
        report: Gathers what each stage did.
        workers: Processes; 0: one for each core.
        force: Run tasks whose outputs are current, too.
    """

    def __init__(self, project: Project, report: Report, workers: int, force: bool) -> None:
        self._project = project
        self._report = report
        self._workers = Workers(workers or available_cores())
        self._force = force

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._workers.__exit__(*error)

    def convert(self) -> None:
        """Raw logs to `signals/` and `synced/`."""
        from .ingest.convert import plan_conversion

        self._stage("convert", *plan_conversion(self._project))
        rows: list[Sequence[Any]] = []
        for key, entry in self._entries("recordings").items():
            synced: dict[str, Any] = next((o for o in entry["outputs"] if o["path"].startswith("synced/")), {})
            frames = sum(i["accepted"] for i in entry["inputs"] if i["kind"] == "can")
            samples = sum(i["accepted"] for i in entry["inputs"] if i["kind"] == "nav")
            lost = sum(i["rejected"] for i in entry["inputs"])
            clock = entry["clock"]
            offset = clock["offset_s"] if clock["applied"] else None
            rows.append((key, frames, samples, lost, synced.get("rows"), synced.get("runs"), offset))
        heads = ("recording", "CAN frames", "nav packets", "rejected", "synced rows", "runs", "CAN clock offset, s")
        self._report.tables.append(("Recordings", heads, rows))
        if odd := list(self._odd_stamps()):
            heads = ("recording", "file", "stamps that go back", "by up to, s", "gaps over 1 s", "longest, s", "at")
            self._report.tables.append(("What the logs' own stamps show", heads, odd))

    def _odd_stamps(self) -> Iterator[Sequence[Any]]:
        for key, entry in self._entries("recordings").items():
            for file in entry["inputs"]:
                back, gaps = file["stamps"]["backwards"], file["stamps"]["gaps"]
                if back["count"] or gaps["count"]:
                    at = gaps["at"] if gaps["count"] else back["at"]
                    yield key, file["path"], back["count"], back["worst_s"], gaps["count"], gaps["longest_s"], at

    def build(self) -> None:
        """Synced tables to `events.csv`, `situations.csv` and `dataset/`."""
        from .dataset.build import plan_build
        from .modeling.path_types import cluster_segments

        self._stage("build", *plan_build(self._project, cluster_segments))
        rows: list[Sequence[Any]] = []
        left_out: list[Sequence[Any]] = []
        for driver, entry in self._entries("dataset").items():
            recorded = entry["driven_s"] + sum(entry["excluded"].values())
            rows.append(
                (driver, entry["driven_s"] / 60, entry["distance_m"] / 1000, entry["segments"],
                 len(entry["clusters"]), 100 * (1 - entry["driven_s"] / recorded))
            )  # fmt: skip
            left_out += [
                (driver, why, seconds, 100 * seconds / recorded, entry["undecided"].get(why))
                for why, seconds in entry["excluded"].items()
            ]
        heads = ("driver", "minutes", "km", "segments", "path types", "left out, %")
        self._report.tables.append(("Dataset", heads, rows))
        reasons = ("driver", "left out because of", "s", "% of the recordings", "s that nobody decided about")
        self._report.tables.append(("Left out", reasons, left_out))

    def train(self) -> None:
        """Dataset to `models/`."""
        from .modeling.personal_training import plan_adaptation, plan_population
        from .modeling.train import plan_training

        self._stage("train", *plan_training(self._project))
        if population := plan_population(self._project):
            self._stage("train the population", population, [])
            self._stage("adapt", plan_adaptation(self._project), [])

    def continue_training(self) -> None:
        """New recordings of the dataset to the models in `models/` that go on learning."""
        from .modeling.personal_training import plan_continuation

        self._stage("continue training", *plan_continuation(self._project, anew=self._force))

    def evaluate(self) -> None:
        """Dataset to `results/`."""
        from .modeling.evaluate import gather_results, plan_evaluation

        self._stage("evaluate", *plan_evaluation(self._project))
        for title, heads, rows in gather_results(self._project):
            self._report.tables.append((title, heads, rows))

    def experiment(self, name: Experiment, *, faithful: bool) -> None:
        """Dataset to `results/experiments/`; what is done when the user stops it stays and is gathered."""
        from .modeling.experiments import gather_experiment, plan_experiment

        faithful = faithful or self._project.config.models.faithful
        tasks, problems = plan_experiment(self._project, name, faithful=faithful)
        with patient_interrupts(console(stderr=True)) as stopped, suppress(KeyboardInterrupt):
            self._stage(name, tasks, problems, stopped)
        for title, heads, rows in gather_experiment(self._project, name, faithful=faithful):
            self._report.tables.append((title, heads, rows))
        manifest = Manifest(self._project.directory)
        done = sum(manifest.is_current(task.section, task.name, task.fingerprint) for task in tasks)
        if stopped() and done < len(tasks):
            reason = f"stopped after {done} of {len(tasks)} cells; the same command goes on from there"
            self._report.problems.append(InputError(self._project.directory, name, reason))

    def track(
        self, drivers: Sequence[str] = (), path: str | None = None, offset: float = 0.0, recordings: int | None = None
    ) -> None:
        """Models to drives in closed loop, `results/track.csv`."""
        from .modeling.tracking import RECORDINGS, gather_tracks, plan_tracking

        most = RECORDINGS if recordings is None else recordings
        tasks = plan_tracking(self._project, drivers, path, offset, most)
        self._stage("track", tasks, [])
        self._report.tables += gather_tracks(self._project, tasks)

    def report(self) -> None:
        """Everything there is to `report/index.html`."""
        from .report.page import write_report

        path = write_report(self._project)
        self._report.facts["report"] = str(path)
        self._report.tables.append(("", ("report",), [(str(path),)]))

    def run(self) -> None:
        """All stages; a stage that finds nothing to work on ends the run, and the report is written all the same.

        What reading logs leaves in memory is nothing to models, nor theirs to the report: processes end in between.
        """
        try:
            self.convert()
            self.build()
            self._workers.close()
            self.train()
            self.evaluate()
            self.track()
        except InputError as error:
            if not self._entries("recordings"):
                raise
            self._report.problems.append(error)
        self._workers.close()
        self.report()

    def _stage(
        self,
        title: str,
        tasks: Sequence[Task],
        planning: Sequence[InputError],
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        manifest = Manifest(self._project.directory)
        progress = console(stderr=True)
        result = run_stage(
            title, tasks, planning, manifest, self._workers, progress, force=self._force, stopped=stopped
        )
        self._report.stages[title] = result
        if tasks and len(result.failed) == len(tasks):
            self._report.failed = self._report.command not in ("run", "demo")

    def _entries(self, section: str) -> dict[str, Any]:
        entries: dict[str, Any] = self._project.manifest.get(section, {})
        return dict(sorted(entries.items()))
