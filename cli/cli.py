"""The commands. Each one reads its arguments, lets a stage do the work, and says what was done."""

from __future__ import annotations

import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .output import Report, console
from .schemas.errors import InputError

if TYPE_CHECKING:
    from .pipeline import Pipeline
    from .schemas.project import Project


app = typer.Typer(
    name="wheelprint",
    help="Raw vehicle logs in, personalised driver models out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ProjectOption = Annotated[Path, typer.Option("--project", help="Folder with wheelprint.toml.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Do everything again, not only what changed.")]
WorkersOption = Annotated[int, typer.Option("--workers", min=0, help="Processes; 0: one for each core.")]

HERE = Path()


class ExperimentName(StrEnum):
    """The papers' experiments."""

    motion_primitives = "motion-primitives"
    lookahead = "lookahead"


def _finish(report: Report) -> None:
    report.show()
    if report.status:
        raise typer.Exit(int(report.status))


def _guarded(report: Report, work: Callable[[], None]) -> None:
    """Do the work of a command; bad input that nothing can go on from becomes its one problem and status 1."""
    try:
        work()
    except InputError as error:
        report.problems.append(error)
        report.failed = True
    _finish(report)


def _open(directory: Path) -> Project:
    from .schemas.project import Project

    project = Project(directory)
    _ = project.config
    return project


def _through_pipeline(
    command: str, stages: Callable[[Pipeline], None], directory: Path, workers: int, force: bool, as_json: bool
) -> None:
    from .pipeline import Pipeline

    summary = Report(command, as_json)

    def work() -> None:
        with Pipeline(_open(directory), summary, workers, force) as pipeline:
            stages(pipeline)

    _guarded(summary, work)


@app.command()
def inspect(
    files: Annotated[
        list[Path],
        typer.Argument(help="Raw logs: CAN, navigation, cameras; or folders of them.", show_default=False),
    ],
    database: Annotated[
        list[str] | None,
        typer.Option("--database", help="Database that names messages; default: those of ./wheelprint.toml."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show what raw logs hold: time span, messages, rates, gaps, navigation status, cameras; and how they overlap."""
    from .inspection import inspect_files

    report = Report("inspect", as_json)
    _guarded(report, lambda: inspect_files(report, files, database or []))


@app.command()
def init(
    project: ProjectOption = HERE,
    as_json: JsonOption = False,
) -> None:
    """Write a commented wheelprint.toml and the folder raw/ to put recordings into."""
    from .initialisation import write_project

    report = Report("init", as_json)
    _guarded(report, lambda: write_project(report, project))


@app.command()
def convert(
    project: ProjectOption = HERE, workers: WorkersOption = 0, force: ForceOption = False, as_json: JsonOption = False
) -> None:
    """Decode the raw logs into signals/ and bring them to one grid in synced/."""
    _through_pipeline("convert", lambda pipeline: pipeline.convert(), project, workers, force, as_json)


@app.command()
def build(
    project: ProjectOption = HERE, workers: WorkersOption = 0, force: ForceOption = False, as_json: JsonOption = False
) -> None:
    """Propose events and situations into events.csv and situations.csv, and make the per-driver dataset."""
    _through_pipeline("build", lambda pipeline: pipeline.build(), project, workers, force, as_json)


@app.command()
def review(
    project: ProjectOption = HERE,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port on 127.0.0.1; 0: a free one.")] = 0,
    reviewer: Annotated[
        str | None, typer.Option("--by", "--as", help="Who decides; default: the page asks.", show_default=False)
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser of this machine.")] = True,
) -> None:
    """Open a local page to decide which proposed emergencies to leave out, and to tag driving situations."""
    from .dataset.review import serve

    report = Report("review", as_json=False)
    _guarded(report, lambda: serve(_open(project), port=port, reviewer=reviewer, browser=browser))


@app.command()
def train(
    project: ProjectOption = HERE,
    go_on: Annotated[
        bool,
        typer.Option(
            "--continue",
            help="Instead, let the models online_steering and online_lookahead learn the recordings that are new, one "
            "by one; with --force they begin anew.",
        ),
    ] = False,
    workers: WorkersOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Train every driver's models on all of the driver's data."""

    def stages(pipeline: Pipeline) -> None:
        if go_on:
            pipeline.continue_training()
        else:
            pipeline.train()

    _through_pipeline("train", stages, project, workers, force, as_json)


@app.command()
def evaluate(
    project: ProjectOption = HERE,
    experiment: Annotated[
        ExperimentName | None,
        typer.Option(
            "--experiment",
            help="Instead, one of the papers' experiments into results/experiments/; may be stopped and goes on there.",
        ),
    ] = None,
    faithful: Annotated[
        bool, typer.Option("--faithful", help="The experiment by the papers' formulas as printed.")
    ] = False,
    workers: WorkersOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Cross-validate the models and their baselines into results/, or run one of the papers' experiments."""

    def stages(pipeline: Pipeline) -> None:
        if experiment is None:
            pipeline.evaluate()
        else:
            pipeline.experiment(experiment.value, faithful=faithful)

    if faithful and experiment is None:
        raise typer.BadParameter("only an experiment can be faithful: add --experiment", param_hint="--faithful")
    _through_pipeline("evaluate", stages, project, workers, force, as_json)


@app.command()
def track(
    project: ProjectOption = HERE,
    driver: Annotated[
        list[str] | None, typer.Option("--driver", help="Whose laws, may be repeated; default: everybody's.")
    ] = None,
    path: Annotated[
        str | None,
        typer.Option("--path", help="test-track, or driver/recording; default: test-track and each driver's own."),
    ] = None,
    recordings: Annotated[
        int | None,
        typer.Option(
            "--recordings", min=0, help="Without --path: of each driver, evenly spread; default: 3, 0: all of them."
        ),
    ] = None,
    offset: Annotated[
        float, typer.Option("--offset", min=-5, max=5, help="m to the left of the path, where the car begins.")
    ] = 0.0,
    workers: WorkersOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Drive PP's test track and recorded paths in closed loop with each driver's lookahead laws, into results/."""
    _through_pipeline(
        "track",
        lambda pipeline: pipeline.track(driver or (), path, offset, recordings),
        project,
        workers,
        force,
        as_json,
    )


@app.command()
def report(project: ProjectOption = HERE, as_json: JsonOption = False) -> None:
    """Write report/index.html: one file that opens offline."""
    _through_pipeline("report", lambda pipeline: pipeline.report(), project, 1, True, as_json)


@app.command()
def export(
    to: Annotated[
        str,
        typer.Option("--to", help="csv: the dataset; json, onnx, c: the models; mcap: recordings for a viewer."),
    ],
    project: ProjectOption = HERE,
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: export/ in the project.")] = None,
    driver: Annotated[str | None, typer.Option("--driver", help="Only this driver.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the dataset, the models or the recordings in a form that other programs read."""
    from .exporting import export_project

    summary = Report("export", as_json)
    _guarded(summary, lambda: export_project(summary, _open(project), to, out, driver))


@app.command()
def predict(
    driver: Annotated[str, typer.Option("--driver", help="Whose model predicts.")],
    project: ProjectOption = HERE,
    recording: Annotated[
        str | None, typer.Option("--recording", help="driver/recording; default: all of the driver's.")
    ] = None,
    models: Annotated[
        Path | None,
        typer.Option("--models", help="Project whose models predict; default: this one.", show_default=False),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Predict the steering wheel angle over the next 5 s along recordings of the dataset, into predictions/."""
    from .prediction import predict_recordings

    summary = Report("predict", as_json)
    _guarded(summary, lambda: predict_recordings(summary, _open(project), driver, recording, models))


@app.command()
def run(
    project: ProjectOption = HERE, workers: WorkersOption = 0, force: ForceOption = False, as_json: JsonOption = False
) -> None:
    """Do everything, from raw logs to the report: convert, build, train, evaluate, track, report."""
    _through_pipeline("run", lambda pipeline: pipeline.run(), project, workers, force, as_json)


@app.command()
def simulate(
    project: ProjectOption = HERE,
    seed: Annotated[int, typer.Option("--seed", help="The same seed gives the same bytes.")] = 0,
    drivers: Annotated[int, typer.Option("--drivers", min=1, max=100)] = 4,
    recordings: Annotated[int, typer.Option("--recordings", min=1, help="Recordings of each driver.")] = 2,
    minutes: Annotated[float, typer.Option("--minutes", min=1, help="Length of each recording.")] = 5.0,
    clock_offset: Annotated[float, typer.Option("--clock-offset", help="s, CAN stamp - UTC; recordings vary.")] = 0.8,
    clock_drift: Annotated[float, typer.Option("--clock-drift", help="ppm of the CAN clock.")] = 20.0,
    oxts_on_can: Annotated[
        bool, typer.Option("--oxts-on-can", help="Navigation as CAN frames of an OxTS unit, not as NCOM.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write raw logs of simulated drivers into raw/, and the truth beside it into truth/."""
    from .simulation import simulate_project

    summary = Report("simulate", as_json)
    _guarded(
        summary,
        lambda: simulate_project(
            summary, project, seed, drivers, recordings, minutes, clock_offset, clock_drift, oxts_on_can=oxts_on_can
        ),
    )


@app.command()
def demo(
    project: Annotated[Path, typer.Option("--project", help="Folder for the demo.")] = Path("demo"),
    workers: WorkersOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate four drivers and do everything with their logs: the whole way in a few minutes."""
    from .simulation import simulate_demo

    try:
        simulate_demo(project, console(stderr=True), force=force)
    except InputError as error:
        _finish(Report("demo", as_json, problems=[error], failed=True))
    _through_pipeline("demo", lambda pipeline: pipeline.run(), project, workers, force, as_json)


def version(show: bool) -> None:
    """Print the version and end."""
    if show:
        from . import __version__

        sys.stdout.write(f"wheelprint {__version__}\n")
        raise typer.Exit


@app.callback()
def main(
    _version: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Raw vehicle logs in, personalised driver models out."""
