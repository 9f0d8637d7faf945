"""`wheelprint export`: dataset, models and recordings for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .output import Report
from .schemas.errors import InputError
from .schemas.project import encode_name
from .schemas.store import publish, publish_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .schemas.project import Project

FORMS = ("csv", "json", "mcap", "onnx", "c")


def export_project(report: Report, project: Project, to: str, out: Path | None, driver: str | None) -> None:
    """Export into a folder, one file for each recording (csv, mcap), model (json) or regression of a model (onnx, c).

    Raises:
        InputError: The form is unknown, or what it needs is not there yet.
    """
    if to not in FORMS:
        raise InputError("--to", to, f"no such form; choose one of {', '.join(FORMS)}")
    folder = out or project.directory / "export"
    write = {"csv": _write_csv, "json": _write_json, "mcap": _write_mcap, "onnx": _write_onnx, "c": _write_c}[to]
    files = list(write(project, folder, driver))
    if not files:
        stage = {"csv": "build", "mcap": "convert"}.get(to, "train")
        whose = "" if driver is None else f" of driver {driver!r}"
        raise InputError(project.directory, "", f"nothing{whose} to export yet; run `wheelprint {stage}` first")
    report.tables.append(("Exported", ("file", "MB"), [(str(path), path.stat().st_size / 1e6) for path in files]))


def _write_csv(project: Project, folder: Path, driver: str | None) -> Iterator[Path]:
    import pyarrow.csv as pacsv

    from .schemas.store import read_table

    for recording in project.recordings():
        source = project.dataset_file(recording.driver, recording.name)
        if driver in (None, recording.driver) and source.exists():
            path = folder / f"{encode_name(recording.driver)}.{encode_name(recording.name)}.csv"
            with publish(path) as draft:
                pacsv.write_csv(read_table(source), draft)
            yield path


def _write_json(project: Project, folder: Path, driver: str | None) -> Iterator[Path]:
    import numpy as np

    for name, entry in sorted(project.manifest.get("models", {}).items()):
        model, _, whose = name.partition("/")
        if driver not in (None, whose):
            continue
        content: dict[str, Any] = {"model": model, "driver": whose, "arrays": {}}
        for output in entry["outputs"]:
            source = project.directory / output["path"]
            if source.suffix == ".npz":
                with np.load(source, allow_pickle=False) as arrays:
                    content["arrays"] |= {key: arrays[key].tolist() for key in arrays.files}
            elif source.suffix == ".json":
                content["card"] = json.loads(source.read_text(encoding="utf-8"))
        path = folder / f"{model}.{encode_name(whose)}.json"
        publish_json(path, content)
        yield path


def _write_mcap(project: Project, folder: Path, driver: str | None) -> Iterator[Path]:
    from .report.viewer import export_mcap

    for recording in project.recordings():
        if driver in (None, recording.driver) and project.synced_file(recording.driver, recording.name).exists():
            path = folder / f"{encode_name(recording.driver)}.{encode_name(recording.name)}.mcap"
            export_mcap(project, recording.driver, recording.name, path)
            yield path


def _write_onnx(project: Project, folder: Path, driver: str | None) -> Iterator[Path]:
    from .modeling.export.exported_models import export_models

    return export_models(project, folder, driver, "onnx")


def _write_c(project: Project, folder: Path, driver: str | None) -> Iterator[Path]:
    from .modeling.export.exported_models import export_models

    return export_models(project, folder, driver, "c")
