"""Decoding one CAN log into one Parquet file for each message, in bounded memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from ..schemas.project import encode_name
from ..schemas.store import parquet_writer, publish
from .account import Account
from .can.database import Database
from .can.decode import MessageDecoder, decode_message, decoder_of, split_by_message
from .can.frames import ERROR, REMOTE, FrameBatch
from .readers import FrameReader
from .stamps import Stamps

LOT_BYTES = 12 << 20
"""Of frames that are decoded together: what is written at once compresses better and faster.
A full batch of classic frames is a little more, so it is a lot by itself: two of them would be copied together."""
OTHER_BYTES = 17
"""Of a frame, beside its payload."""
COLUMNS_BYTES = 8 << 20
"""Of a message's columns, decoded and written at once."""


@dataclass(slots=True)
class DecodedLog:
    """What became of a CAN log.

    Attributes:
        files: The published file of each message.
        rows: Frames of each message.
        unknown: Data frames of each identifier that no database knows, as `0x123` or, extended, `0x00000123x`.
        remote: Remote frames; they have no payload.
        errors: Error frames.
        stamps: What the frames' stamps show.
    """

    files: dict[str, Path] = field(default_factory=dict)
    rows: Counter[str] = field(default_factory=Counter)
    unknown: Counter[str] = field(default_factory=Counter)
    remote: int = 0
    errors: int = 0
    stamps: Stamps = field(default_factory=Stamps)


def signal_file(folder: Path, log: str, message: str) -> Path:
    """Return where the signals of a message are stored: `<log file name>.<message>.parquet`."""
    return folder / f"{encode_name(log)}.{encode_name(message)}.parquet"


def decode_log(reader: FrameReader, account: Account, database: Database, folder: Path, log: str) -> DecodedLog:
    """Decode every known message of a log into `folder`.

    Args:
        reader: The log.
        account: Filled by the reader.
        database: The messages to decode.
        folder: Where the files go; each holds `time` (the logger's stamp, not corrected), `channel` and the message's
            signals in physical values, with unit, description and value table in the fields' metadata.
        log: Name of the log within the recording, for the file names.

    Raises:
        InputError: The log is damaged in a way that its reader cannot go on from; nothing is published.
    """
    decoded = DecodedLog()
    decoders: dict[str, MessageDecoder] = {}
    writers: dict[str, pq.ParquetWriter] = {}
    # Arrow and compiled code run beside the reader's: while one lot is decoded and written, the next one is read.
    with ExitStack() as drafts, ThreadPoolExecutor(1) as thread:

        def write(lot: list[FrameBatch]) -> None:
            frames_of_all = FrameBatch.join(lot)
            lot.clear()
            known, unknown = split_by_message(frames_of_all, database)
            del frames_of_all  # These and those of the lot would else be kept while the next lot is read.
            for (identifier, extended), count in unknown.items():
                decoded.unknown[f"0x{identifier:08X}x" if extended else f"0x{identifier:03X}"] += count
            for layout, frames in known:
                name = layout.name
                if name not in writers:
                    decoded.files[name] = path = signal_file(folder, log, name)
                    decoder = decoders[name] = decoder_of(layout)
                    schema = decoder.schema.with_metadata({**decoder.schema.metadata, "source": log, "clock": "logger"})
                    writers[name] = drafts.enter_context(parquet_writer(drafts.enter_context(publish(path)), schema))
                decoded.rows[name] += len(frames)
                decoder, writer = decoders[name], writers[name]
                size = max(COLUMNS_BYTES // (8 * len(decoder.schema)), 1)
                for first in range(0, len(frames), size):
                    columns = decode_message(decoder, frames.part(slice(first, first + size)))
                    writer.write_batch(columns.replace_schema_metadata(writer.schema.metadata))

        writing: Future[None] | None = None
        for lot in _lots(reader.batches(account), decoded):
            if writing is not None:
                writing.result()
            writing = thread.submit(write, lot)
        if writing is not None:
            writing.result()
    return decoded


def _lots(batches: Iterable[FrameBatch], decoded: DecodedLog) -> Iterator[list[FrameBatch]]:
    """Yield batches, counted, so many at a time that their frames take about `LOT_BYTES`."""
    lot: list[FrameBatch] = []
    size = 0
    for batch in batches:
        if len(batch) == 0:
            continue
        _count(decoded, batch)
        lot.append(batch)
        size += batch.data.nbytes + len(batch) * OTHER_BYTES
        if size >= LOT_BYTES:
            yield lot
            lot, size = [], 0
    if lot:
        yield lot


def _count(decoded: DecodedLog, batch: FrameBatch) -> None:
    decoded.remote += int(np.count_nonzero(batch.kind == REMOTE))
    decoded.errors += int(np.count_nonzero(batch.kind == ERROR))
    decoded.stamps.add(batch.time)


def as_facts(decoded: DecodedLog) -> dict[str, object]:
    """Return the counts for the manifest: accepted frames = decoded + unknown + remote + errors."""
    return {
        "decoded": sum(decoded.rows.values()),
        "unknown": sum(decoded.unknown.values()),
        "unknown_ids": dict(sorted(decoded.unknown.items())),
        "remote": decoded.remote,
        "errors": decoded.errors,
    }
