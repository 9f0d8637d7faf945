"""A project on disk: its configuration, its recordings, its paths and its tables."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from .config import Config, read_config
from .errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

LONGEST_NAME = 120


def encode_name(name: str) -> str:
    """Return a driver's or recording's name as a file name: ASCII, no separators, never `.` or `..`, at most 120 long.

    Two names never give the same file name: what is too long ends in `~` and a hash, and a `~` of its own is escaped.
    """
    encoded = quote(name, safe=" ").replace("~", "%7E").replace(" ", "%20")
    if encoded.startswith("."):
        encoded = "%2E" + encoded[1:]
    if len(encoded) <= LONGEST_NAME:
        return encoded
    return f"{encoded[: LONGEST_NAME - 17]}~{hashlib.sha256(name.encode()).hexdigest()[:16]}"


@dataclass(frozen=True, slots=True, order=True)
class Recording:
    """One drive of one driver: a folder of raw logs."""

    driver: str
    name: str
    folder: Path

    @property
    def key(self) -> str:
        """`driver/recording`, as the manifest and `events.csv` name it."""
        return f"{self.driver}/{self.name}"


class Project:
    """A project folder.

    Args:
        directory: The folder that holds `wheelprint.toml`.
    """

    def __init__(self, directory: str | Path) -> None:
        self.directory = Path(directory).resolve()

    @cached_property
    def config(self) -> Config:
        """The validated project file; `InputError` where it is missing or wrong."""
        return read_config(self.directory / "wheelprint.toml")

    @property
    def manifest(self) -> dict[str, Any]:
        """The content of `manifest.json`, empty before the first stage."""
        from .store import Manifest

        return Manifest(self.directory).content

    def recordings(self) -> list[Recording]:
        """Return the recordings that the layout finds, sorted by driver and name.

        Raises:
            InputError: There is none.
        """
        pattern = self.config.layout.recordings
        found = sorted(_folders(self.directory, pattern))
        if not found:
            reason = f"no folder matches layout.recordings = {pattern!r}; put each recording's logs into such a folder"
            raise InputError(self.directory / "wheelprint.toml", "layout.recordings", reason)
        return found

    def signals_folder(self, driver: str, recording: str) -> Path:
        """`signals/driver=…/recording=…`."""
        return self._partition("signals", driver, recording)

    def synced_file(self, driver: str, recording: str) -> Path:
        """`synced/driver=…/recording=…/part-0.parquet`."""
        return self._partition("synced", driver, recording) / "part-0.parquet"

    def dataset_file(self, driver: str, recording: str) -> Path:
        """`dataset/driver=…/recording=…/part-0.parquet`."""
        return self._partition("dataset", driver, recording) / "part-0.parquet"

    def data_card_file(self, driver: str) -> Path:
        """`dataset/driver=…/_card.json`; what reads a folder of Parquet files passes over names that begin with `_`."""
        return self.directory / "dataset" / f"driver={encode_name(driver)}" / "_card.json"

    def model_folder(self, model: str, driver: str) -> Path:
        """`models/<model>/<driver>`."""
        return self.directory / "models" / model / encode_name(driver)

    def cameras_file(self, driver: str, recording: str) -> Path:
        """`signals/driver=…/recording=…/cameras.parquet`."""
        return self.signals_folder(driver, recording) / "cameras.parquet"

    @property
    def events_file(self) -> Path:
        """`events.csv`."""
        return self.directory / "events.csv"

    @property
    def situations_file(self) -> Path:
        """`situations.csv`."""
        return self.directory / "situations.csv"

    @property
    def results_folder(self) -> Path:
        """`results`."""
        return self.directory / "results"

    @property
    def report_file(self) -> Path:
        """`report/index.html`."""
        return self.directory / "report" / "index.html"

    def synced(self, driver: str | None = None) -> pa.Table:
        """Return the synced tables of one driver or of all, with `driver` and `recording` as first columns."""
        return self._read("recordings", self.synced_file, driver)

    def dataset(self, driver: str | None = None, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the dataset of one driver or of all, or some columns of it, with `driver` and `recording` as first."""
        return self._read("dataset", self.dataset_file, driver, columns)

    def cameras(self, driver: str, recording: str) -> pa.Table:
        """Return when a recording's cameras took their frames, in the order of time, in the schema `CAMERA_FRAMES`.

        `path` is relative to the recording's folder (`Recording.folder`). A recording without cameras, or one that
        was not converted yet, has an empty table.

        Raises:
            InputError: The stored index is damaged.
        """
        from .store import read_table
        from .tables import CAMERA_FRAMES

        path = self.cameras_file(driver, recording)
        entry = self.manifest.get("recordings", {}).get(f"{driver}/{recording}", {})
        confirmed = {output["path"] for output in entry.get("outputs", ())}
        if path.relative_to(self.directory).as_posix() not in confirmed:
            return CAMERA_FRAMES.empty_table()
        return read_table(path)

    def _partition(self, stage: str, driver: str, recording: str) -> Path:
        return self.directory / stage / f"driver={encode_name(driver)}" / f"recording={encode_name(recording)}"

    def _read(self, section: str, file: Any, driver: str | None, columns: Sequence[str] | None = None) -> pa.Table:
        import pyarrow as pa

        from .store import read_table

        confirmed = {output["path"] for entry in self.manifest.get(section, {}).values() for output in entry["outputs"]}
        tables = []
        for recording in self.recordings():
            path = file(recording.driver, recording.name)
            if driver in (None, recording.driver) and path.relative_to(self.directory).as_posix() in confirmed:
                table = read_table(path, columns).replace_schema_metadata()
                for place, (name, whose) in enumerate((("driver", recording.driver), ("recording", recording.name))):
                    table = table.add_column(place, name, pa.repeat(whose, len(table)))
                tables.append(table)
        if not tables:
            stage = {"recordings": "convert", "dataset": "build"}[section]
            whose = "" if driver is None else f" of driver {driver!r}"
            raise InputError(self.directory, "", f"no recording{whose} is there yet; run `wheelprint {stage}` first")
        return pa.concat_tables(tables)


def _folders(base: Path, pattern: str) -> Iterable[Recording]:
    """Yield every folder that matches a pattern such as `raw/{driver}/{recording}`; links are followed."""
    places: list[tuple[Path, dict[str, str]]] = [(Path("/") if pattern.startswith("/") else base, {})]
    for part in Path(pattern).parts:
        if part == "/":
            continue
        expression = re.compile(
            "".join(
                f"(?P<{piece[1:-1]}>.+)" if piece in ("{driver}", "{recording}") else re.escape(piece)
                for piece in re.split(r"(\{driver\}|\{recording\})", part)
            )
        )
        if "{" not in part:
            places = [(place / part, names) for place, names in places if (place / part).is_dir()]
            continue
        places = [
            (child, names | match.groupdict())
            for place, names in places
            for child in sorted(place.iterdir())
            if child.is_dir() and not child.name.startswith(".") and (match := expression.fullmatch(child.name))
        ]
    return (Recording(names["driver"], names["recording"], place) for place, names in places)
