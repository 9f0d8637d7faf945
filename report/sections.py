"""What the report shows, section by section; a section whose data is not there yet says what makes it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from ..dataset.events import Event, read_events
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import read_table
from ..schemas.tables import LOOKAHEAD_COLUMNS, MOTION_PRIMITIVE_COLUMNS
from . import accuracy, drive_figures, model_figures, tables
from .blocks import Block, Column, Facts, Figure, Gallery, Listing, Note, Section, Table
from .closed_loop import closed_loop_blocks
from .data_cards import driving_table, folds_table, road_table
from .drives import Drive, column, describe, readable
from .experiments import experiment_blocks
from .personal import personal_blocks
from .predictions import predicted_stretch
from .provenance import inputs_table, parameters_table, signals_table, versions_table
from .scores import read_scores
from .sources import cameras_table, frames_table, repairs_table, stamps_table
from .tables import count, entries, number, text

MAP_POINTS = 120_000
"""Points of all maps together: they decide the size of the file."""
MAP_POINTS_EACH = (200, 3000)

Result = TypeVar("Result")


class Content:
    """The content of one project's report.

    Args:
        project: The project; everything is read when the sections are made.
    """

    def __init__(self, project: Project) -> None:
        self.project = project
        self.config = project.config
        self.manifest = project.manifest
        self.problems: list[tuple[str, str]] = []
        self.period = self.config.sync.period / 1e9
        self.trusted = self.config.sync.clock == "trust"
        self.events = self._guarded(read_events, project.events_file) or []
        self.drives = list(self._drives())
        self._collect_problems()

    def sections(self) -> list[Section]:
        """Return all sections in their order; the summary comes first and knows what the others met."""
        rest = [
            Section("recordings", "Recordings", self._recordings()),
            Section("alignment", "Time alignment", self._alignment()),
            Section("events", "Events", self._events()),
            Section("dataset", "Dataset", self._dataset()),
            Section("maps", "Maps", self._maps()),
            Section("lookahead", "Lookahead", self._lookahead()),
            Section("clusters", "Clusters", self._clusters()),
            Section("errors", "Model errors", self._errors()),
            Section("personal", "Personal", self._guarded(personal_blocks, self.project) or []),
            Section("experiments", "The papers’ experiments", self._guarded(experiment_blocks, self.project) or []),
            Section("closed-loop", "Closed loop", self._guarded(closed_loop_blocks, self.project) or []),
            Section("prediction", "Prediction", self._predictions()),
            Section("provenance", "Provenance", self._provenance()),
        ]
        return [Section("summary", "Summary", self._summary()), *rest]

    def _guarded(self, read: Callable[..., Result], *of: Any) -> Result | None:
        """Read a file, or compute from files; where one is missing or wrong, return None and list the problem."""
        try:
            return read(*of)
        except InputError as error:
            self.problems.append((_where(error.path, error.where, self.project), error.reason))
            return None

    def _tables(self, outputs: Iterable[Mapping[str, Any]]) -> list[pa.Table]:
        found = (self._guarded(read_table, self.project.directory / output["path"]) for output in outputs)
        return [table for table in found if table is not None and len(table)]

    def _drives(self) -> Iterator[Drive]:
        recordings = entries(self.manifest, "recordings")
        at_most = int(np.clip(MAP_POINTS // max(len(recordings), 1), *MAP_POINTS_EACH))
        for key, entry in recordings:
            driver, _, name = key.partition("/")
            table = self._tables(output for output in entry["outputs"] if output["path"].startswith("synced/"))
            built = self.manifest.get("dataset", {}).get(driver, {}).get("outputs", ())
            dataset = self._tables(output for output in built if output["recording"] == name)
            events = [event for event in self.events if event.recording == key]
            if table:
                yield describe(
                    key, table[0], dataset[0] if dataset else None, entry["clock"], events, self.period, at_most
                )

    def _collect_problems(self) -> None:
        try:
            waiting = [r.key for r in self.project.recordings() if r.key not in self.manifest.get("recordings", {})]
        except InputError:
            waiting = []
        self.problems += [(key, "not in the manifest: not converted yet, or it could not be") for key in waiting]
        for section, named in sorted(self.manifest.items()):
            for name, entry in sorted(named.items()):
                if isinstance(entry, Mapping):
                    for problem in entry.get("problems", ()):
                        place = _where(problem["path"], problem["where"], self.project)
                        self.problems.append((f"{section} {name}: {place}", problem["reason"]))
        for key, entry in entries(self.manifest, "recordings"):
            if not entry["clock"]["applied"] and not self.trusted:
                reason = entry["clock"]["reason"]
                self.problems.append((key, f"the CAN clock was not aligned: {reason}; CAN and navigation may be apart"))
        if reason := self.manifest.get("calibration", {}).get("reason"):
            self.problems.append(("steering calibration", reason))
        known = {name for name, _ in entries(self.manifest, "recordings")}
        for name in sorted({event.recording for event in self.events} - known):
            self.problems.append(("events.csv", f"events of {name!r}, which is no converted recording"))
        undecided = sum(event.decision == "proposed" for event in self.events)
        if undecided:
            reason = f"{undecided} proposed events are left out and nobody has looked at them yet: `wheelprint review`"
            self.problems.append(("events.csv", reason))

    def _summary(self) -> list[Block]:
        recordings = entries(self.manifest, "recordings")
        files = [file for _, entry in recordings for file in entry["inputs"]]
        accepted, rejected = (sum(file[what] for file in files) for what in ("accepted", "rejected"))
        dataset = [entry for _, entry in entries(self.manifest, "dataset")]
        drivers = sorted({key.partition("/")[0] for key, _ in recordings})
        items = [
            (self.config.vehicle.name, f"vehicle, wheelbase {self.config.vehicle.wheelbase:g} m"),
            (str(len(drivers)), f"drivers: {', '.join(drivers)}" if drivers else "drivers"),
            (str(len(recordings)), "recordings"),
            (f"{sum(d.driven for d in self.drives) / 3600:.2f} h", "synced, without gaps"),
            (f"{sum(d.distance for d in self.drives) / 1000:.1f} km", "synced, without gaps"),
        ]
        if dataset:
            items += [
                (f"{sum(entry['driven_s'] for entry in dataset) / 3600:.2f} h", "in the dataset"),
                (f"{sum(entry['distance_m'] for entry in dataset) / 1000:.1f} km", "in the dataset"),
            ]
        items.append((f"{accepted + rejected:,}", f"records in = {accepted:,} accepted + {rejected:,} rejected"))
        items += _calibration(self.manifest.get("calibration", {}))
        if not recordings:
            return [Facts(items[:1]), *self._problem_list(), NOTHING_CONVERTED]
        return [*self._problem_list(), Facts(items)]

    def _problem_list(self) -> list[Block]:
        found = list(dict.fromkeys(self.problems))
        if not found:
            return [Note("No problems were recorded.")]
        return [Listing(f"{len(found)} problem{'s' if len(found) > 1 else ''}", found)]

    def _recordings(self) -> list[Block]:
        if not entries(self.manifest, "recordings"):
            return [NOTHING_CONVERTED]
        more = (make(self.manifest) for make in (frames_table, stamps_table, cameras_table))
        recordings = tables.recordings_table(self.manifest, self.period, self.trusted)
        return [recordings, *(table for table in more if table is not None)]

    def _alignment(self) -> list[Block]:
        if not entries(self.manifest, "recordings"):
            return [NOTHING_CONVERTED]
        shown = [drive.alignment for drive in self.drives if isinstance(drive.alignment, Figure)]
        blank = {drive.key: drive.alignment for drive in self.drives if isinstance(drive.alignment, str)}
        synced = {drive.key for drive in self.drives}
        blank |= {
            key: "CAN and navigation were not brought together; the problems in the summary say why"
            for key, _ in entries(self.manifest, "recordings")
            if key not in synced
        }
        blocks: list[Block] = [tables.clock_table(self.manifest, self.trusted)]
        if shown:
            blocks.append(Gallery(shown))
        if blank:
            blocks.append(Listing("Recordings whose speeds cannot be compared", sorted(blank.items())))
        return blocks

    def _events(self) -> list[Block]:
        blocks: list[Block] = []
        if self.events:
            starts = {drive.key: drive.start for drive in self.drives}
            lanes = [
                drive_figures.Lane(
                    drive.key,
                    drive.minutes,
                    [
                        (
                            (event.start - drive.start) / 60e9,
                            (event.stop - drive.start) / 60e9,
                            event.kind,
                            event.decision,
                        )
                        for event in self.events
                        if event.recording == drive.key
                    ],
                )
                for drive in self.drives
            ]
            caption = "When events happened. Proposed events and emergencies are left out of the dataset."
            if lanes:
                blocks.append(Gallery([Figure(caption, drive_figures.timeline(lanes))], wide=True))
            blocks.append(_events_table(self.events, starts))
        elif self.project.events_file.exists():
            blocks.append(Note("events.csv holds no event."))
        else:
            blocks.append(Note("No events were proposed yet.", "wheelprint build"))
        if entries(self.manifest, "dataset"):
            recorded: dict[str, float] = {}
            for drive in self.drives:
                driver = drive.key.partition("/")[0]
                recorded[driver] = recorded.get(driver, 0.0) + drive.synced
            blocks.append(tables.excluded_table(self.manifest, recorded))
            blocks.append(tables.situations_table(self.manifest))
        return blocks

    def _dataset(self) -> list[Block]:
        documents = [
            document for _, entry in entries(self.manifest, "dataset") for document in entry.get("documents", ())
        ]
        found = (self._guarded(_read_card, self.project.directory / document["path"]) for document in documents)
        cards = [card for card in found if card is not None]
        return [make(cards) for make in (driving_table, road_table, folds_table)] if cards else [NOTHING_BUILT]

    def _maps(self) -> list[Block]:
        shown = [drive.track for drive in self.drives if drive.track]
        if shown:
            return [Gallery(shown)]
        return [NOTHING_CONVERTED if not self.drives else Note("No recording has positions.")]

    def _lookahead(self) -> list[Block]:
        shown = []
        for driver, entry in entries(self.manifest, "dataset"):
            names = ("speed", "lookahead", "lookahead_spread")
            found = [table.select(names) for table in self._tables(entry["outputs"])]
            if not found:
                continue
            table = pa.concat_tables(found)
            speed, distance, spread = (column(table, name) for name in names)
            caption = (
                f"{driver}: lookahead distance over speed; defined for {100 * np.isfinite(distance).mean():.0f} % of "
                f"{len(distance):,} rows. Its spread, the range of distances that explain the steering as well, has a "
                f"median of {np.nanmedian(spread) if np.isfinite(spread).any() else math.nan:.1f} m."
            )
            shown.append(Figure(caption, drive_figures.lookahead(speed, distance, spread)))
        return [Gallery(shown) if shown else NOTHING_BUILT]

    def _clusters(self) -> list[Block]:
        dataset = entries(self.manifest, "dataset")
        if not dataset:
            return [NOTHING_BUILT]
        blocks: list[Block] = [tables.cluster_table(self.manifest)]
        fits = {driver: entry["bic"] for driver, entry in dataset if entry.get("bic")}
        if fits:
            caption = "Bayesian information criterion of the cluster models; the smallest one is chosen."
            blocks.append(Gallery([Figure(caption, model_figures.information_criterion(fits))]))
        return blocks

    def _errors(self) -> list[Block]:
        blocks: list[Block] = []
        for name, columns, table, figure, caption in (
            ("lookahead.csv", LOOKAHEAD_COLUMNS, tables.lookahead_table, model_figures.errors_by_components,
             "errors of the lookahead models over their number of components; bars: sd over the folds."),
            ("motion_primitives.csv", MOTION_PRIMITIVE_COLUMNS, tables.motion_primitives_table,
             model_figures.errors_of_models, "errors of the motion primitives and baselines; bars: sd over the folds."),
        ):  # fmt: skip
            path = self.project.results_folder / name
            scores = (self._guarded(read_scores, path, columns) if path.exists() else None) or []
            if not scores:
                blocks.append(Note(f"There is no results/{name} with results yet.", "wheelprint evaluate"))
            for driver in dict.fromkeys(score.driver for score in scores):
                own = [score for score in scores if score.driver == driver]
                blocks.append(table(driver, own))
                blocks.append(Gallery([Figure(f"{driver}: {caption}", figure(own))], wide=True))
        return [*blocks, *self._accuracy()]

    def _accuracy(self) -> list[Block]:
        blocks: list[Block] = []
        for name, over, value, draw, caption in (
            ("horizons.csv", "horizon", "mean_error", accuracy.errors_by_horizon,
             "average error of the steering wheel angle by horizon, mean over the test folds."),
            ("calibration.csv", "probability", "share", accuracy.reliability,
             "how much of what happened the bands hold, over what they state; above the line they are too wide."),
        ):  # fmt: skip
            path = self.project.results_folder / name
            curves = (self._guarded(accuracy.read_curves, path, over, value) if path.exists() else None) or {}
            shown = [Figure(f"{driver}: {caption}", draw(models)) for driver, models in curves.items()]
            if shown:
                blocks.append(Gallery(shown, wide=True))
        return blocks

    def _predictions(self) -> list[Block]:
        trained = [name.partition("/") for name, _ in entries(self.manifest, "models")]
        drivers = [driver for model, _, driver in trained if model == "motion_primitives"]
        if not drivers:
            return [Note("No model of motion primitives was trained yet.", "wheelprint train")]
        shown = []
        for driver in drivers:
            outputs = self.manifest.get("dataset", {}).get(driver, {}).get("outputs", ())
            names = [output["recording"] for output in outputs]
            figure = self._guarded(predicted_stretch, self.project, driver, names)
            if figure is not None:
                shown.append(figure)
        caution = (
            "The models were trained on all data of their driver, these stretches included. Section “Model errors” "
            "says how well they do on data that they have not seen."
        )
        return [Note(caution), Gallery(shown, wide=True)] if shown else [Note("No recording has a whole window.")]

    def _provenance(self) -> list[Block]:
        converted = bool(entries(self.manifest, "recordings"))
        if not converted:
            return [NOTHING_CONVERTED, versions_table(), parameters_table(self.config)]
        repairs = repairs_table(self.manifest)
        read = [signals_table(self.manifest), *([repairs] if repairs else []), inputs_table(self.manifest)]
        return [*read, versions_table(), parameters_table(self.config)]


NOTHING_CONVERTED = Note("No recording was converted yet.", "wheelprint convert")
NOTHING_BUILT = Note("The dataset was not built yet.", "wheelprint build")


def _read_card(path: Path) -> dict[str, Any]:
    try:
        card: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(path, "", f"cannot be read ({error}); run `wheelprint build --force`") from None
    return card


def _events_table(events: list[Event], starts: Mapping[str, int]) -> Table:
    rows = [
        [
            text(event.recording),
            text(readable(event.start)),
            number((event.start - starts[event.recording]) / 1e9 if event.recording in starts else None, 1),
            number((event.stop - event.start) / 1e9, 1),
            text(event.kind),
            number(event.severity, 2),
            text(event.decision, "alert" if event.decision == "proposed" else ""),
            text(event.decided_by),
            text("no" if event.is_left_out else "yes"),
            text(event.note),
        ]
        for event in events
    ]
    columns = [
        Column("Recording", numeric=False), Column("Start", "UTC", numeric=False), Column("After start", "s"),
        Column("Duration", "s"), Column("Kind", numeric=False), Column("Severity", "× threshold"),
        Column("Decision", numeric=False), Column("Decided by", numeric=False), Column("In dataset", numeric=False),
        Column("Note", numeric=False),
    ]  # fmt: skip
    caption = f"{count(len(events)).text} events; `wheelprint review` shows each one and stores decisions."
    return Table(caption, columns, rows)


def _calibration(calibration: Mapping[str, Any]) -> list[tuple[str, str]]:
    items = []
    estimated = calibration.get("estimated", ())
    for key, name, unit in (("steering_ratio", "steering ratio", ""), ("steering_offset_deg", "steering offset", "°")):
        value, error = calibration.get(key), calibration.get(f"{key}_standard_error")
        if value is None:
            continue
        if key.removesuffix("_deg") in estimated and error:
            digits = max(1 - math.floor(math.log10(error)), 0)
            items.append((f"{value:.{digits}f} ± {error:.{digits}f}{unit}", f"{name}, estimated ± standard error"))
        else:
            items.append((f"{value:g}{unit}", f"{name}, given in wheelprint.toml"))
    return [(value.replace("-", "−"), meaning) for value, meaning in items]


def _where(path: str, where: str, project: Project) -> str:
    short = path.removeprefix(f"{project.directory}/")
    return f"{short}, {where}" if where else short
