"""Publishing files so that they are either whole or absent, and the manifest that confirms them."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from .errors import InputError

PAGE = 1 << 17
"""Bytes of a page of a Parquet column before compression: they stay in the second cache while they are made."""


@contextmanager
def publish(path: Path) -> Iterator[Path]:
    """Yield a path beside `path` to write to; on success it replaces `path`, durably, else it is removed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".draft-{os.getpid()}-{hashlib.sha256(path.name.encode()).hexdigest()[:16]}")
    try:
        yield draft
        with draft.open("rb") as written:
            os.fsync(written.fileno())
        draft.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    finally:
        draft.unlink(missing_ok=True)


def publish_text(path: Path, text: str) -> None:
    """Publish `text` as UTF-8 with its line ends as they are."""
    with publish(path) as draft:
        draft.write_bytes(text.encode())


def publish_json(path: Path, content: Any) -> None:
    """Publish `content` as JSON: sorted keys, no NaN, the same content gives the same bytes."""
    publish_text(path, json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder against everybody else who asks for it in this way, at the longest until the process ends.

    What is read, changed and written back within loses nothing that another process of Wheelprint writes.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


@contextmanager
def parquet_writer(
    path: Path, schema: pa.Schema, *, level: int = 1, buffer: int = 1 << 16
) -> Iterator[pq.ParquetWriter]:
    """Open a Parquet writer with the settings that measured best: see the design, "Work and files".

    Row groups tell the range of their stamps, by which readers choose them; that of every signal would cost an eighth
    of all writing. Pages are of the second version, since in the first one values are copied once more.

    Args:
        path: Of the file.
        schema: Of its rows.
        level: Of Zstandard. Below 0 it does not code single bytes any more, only repetitions.
        buffer: Bytes that go to the system together. A call for each page would cost a twentieth of writing.
    """
    plain = [f.name for f in schema if not (pa.types.is_string(f.type) or pa.types.is_dictionary(f.type))]
    floats = [f.name for f in schema if pa.types.is_floating(f.type)]
    steps = [f.name for f in schema if pa.types.is_timestamp(f.type) or pa.types.is_integer(f.type)]
    with (
        pa.BufferedOutputStream(pa.OSFile(str(path), "w"), buffer) as file,
        pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            compression_level=level,
            use_dictionary=[f.name for f in schema if f.name not in plain],
            write_statistics=[f.name for f in schema if pa.types.is_timestamp(f.type)],
            column_encoding=dict.fromkeys(steps, "DELTA_BINARY_PACKED") | dict.fromkeys(floats, "BYTE_STREAM_SPLIT"),
            write_page_checksum=True,
            data_page_version="2.0",
            data_page_size=PAGE,
            write_batch_size=PAGE // 8,
        ) as writer,
    ):
        yield writer


def publish_table(path: Path, table: pa.Table) -> None:
    """Publish a table as one Parquet file."""
    with publish(path) as draft, parquet_writer(draft, table.schema) as writer:
        writer.write_table(table)


def read_table(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a Parquet file that Wheelprint wrote, its page checksums verified.

    Args:
        path: The file.
        columns: What to read of it; None: all.

    Raises:
        InputError: The file is missing, damaged or not Parquet.
    """
    with _damage_told(path):
        return pq.read_table(
            path, columns=None if columns is None else list(columns), partitioning=None, page_checksum_verification=True
        )


def read_batches(path: Path, columns: Sequence[str]) -> Iterator[pa.RecordBatch]:
    """Yield some columns of a Parquet file that Wheelprint wrote piece by piece, its page checksums verified.

    Raises:
        InputError: The file is missing, damaged or not Parquet.
    """
    with _damage_told(path), pq.ParquetFile(path, page_checksum_verification=True) as file:
        yield from file.iter_batches(columns=list(columns))


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise InputError(path, "", "no such file; run the stage that writes it again") from None
    except (OSError, pa.ArrowInvalid) as error:
        reason = f"not a whole Parquet file ({error}); remove it and run the stage that writes it again"
        raise InputError(path, "", reason) from None


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file's content in hexadecimal."""
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def fingerprint(content: Any) -> str:
    """Return a hash of anything JSON can hold: equal content, equal hash."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, ensure_ascii=False).encode()).hexdigest()


class Manifest:
    """`manifest.json`: which outputs stand for which inputs and parameters.

    An entry is a section ("recordings", "dataset", "models", …), a name within it, and a mapping that holds at least
    `fingerprint` (of inputs and parameters), `outputs` (`path` relative to the project, `sha256`, `bytes`) and
    `problems` (`path`, `where`, `reason`); `documents` are files like outputs that describe them to people.
    """

    def __init__(self, project: Path) -> None:
        self._project = project
        self.path = project / "manifest.json"
        self.content: dict[str, dict[str, Any]] = {}
        if self.path.exists():
            try:
                self.content = json.loads(self.path.read_text(encoding="utf-8"))
            except ValueError as error:
                reason = f"not JSON ({error}); remove it and everything is done again"
                raise InputError(self.path, "", reason) from None

    def entry(self, section: str, name: str) -> dict[str, Any]:
        """Return an entry, empty where there is none."""
        found: dict[str, Any] = self.content.get(section, {}).get(name, {})
        return found

    def is_current(self, section: str, name: str, fingerprint: str) -> bool:
        """Tell whether the entry was made from the same inputs and parameters and its outputs still stand."""
        entry = self.entry(section, name)
        return entry.get("fingerprint") == fingerprint and all(
            (file := self._project / output["path"]).is_file() and file.stat().st_size == output["bytes"]
            for output in _files(entry)
        )

    def record(self, section: str, name: str, entry: Mapping[str, Any]) -> None:
        """Put an entry in place of the one before, remove the files only that one stood for, and save."""
        old = self.entry(section, name)
        kept = {output["path"] for output in _files(entry)}
        self.content.setdefault(section, {})[name] = dict(entry)
        publish_json(self.path, self.content)
        for output in _files(old):
            if output["path"] not in kept:
                (self._project / output["path"]).unlink(missing_ok=True)

    def put(self, section: str, content: Mapping[str, Any]) -> None:
        """Put a section that is one record instead of entries, such as `calibration`, and save."""
        self.content[section] = dict(content)
        publish_json(self.path, self.content)

    def remove(self, section: str, name: str) -> None:
        """Remove an entry and the files it stood for: what could not be made again must not pass for current."""
        if self.entry(section, name):
            self.record(section, name, {"outputs": []})
            del self.content[section][name]
            publish_json(self.path, self.content)


def _files(entry: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [*entry.get("outputs", ()), *entry.get("documents", ())]


def describe_output(project: Path, path: Path, **facts: Any) -> dict[str, Any]:
    """Return `path` relative to the project, `sha256`, `bytes` and whatever `facts` say of a published file."""
    return {
        "path": path.relative_to(project).as_posix(),
        "sha256": sha256(path),
        "bytes": path.stat().st_size,
        **facts,
    }
