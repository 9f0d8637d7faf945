"""`wheelprint predict`: the steering wheel angle over the next steps, along recordings of the dataset."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .output import Report
from .schemas.errors import InputError
from .schemas.project import Project, encode_name
from .schemas.store import publish_table


def predict_recordings(
    report: Report, project: Project, driver: str, recording: str | None, models: Path | None
) -> None:
    """Predict along one recording, or all of the driver's, into `predictions/<driver>/<driver>.<recording>.parquet`.

    Args:
        report: Gets a table of the files.
        project: The project.
        driver: Whose model predicts.
        recording: `driver/recording`, of this driver or another one; None: all recordings of this driver.
        models: Folder of the project whose models predict, such as the one that these recordings are new to; None:
            this one.

    Raises:
        InputError: The driver has no model, or there is no such recording.
    """
    from .modeling.drivers import one_thread
    from .modeling.predict import load_steering_model, predict_steering

    known = {found.key: found for found in project.recordings()}
    if recording is not None and recording not in known:
        raise InputError(project.directory, recording, f"no such recording; there are {', '.join(known)}")
    wanted = [known[recording]] if recording else [found for found in known.values() if found.driver == driver]
    model = load_steering_model(project if models is None else Project(models), driver)
    rows: list[Sequence[Any]] = []
    for found in wanted:
        try:
            with one_thread():
                table = predict_steering(project, model, found.driver, found.name)
        except InputError as error:
            report.problems.append(error)
            continue
        name = f"{encode_name(found.driver)}.{encode_name(found.name)}.parquet"
        path = project.directory / "predictions" / encode_name(driver) / name
        publish_table(path, table)
        rows.append((found.key, len(table), str(path)))
    report.failed = not rows
    report.tables.append(("Predictions", ("recording", "windows", "file"), rows))
