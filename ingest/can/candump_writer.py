"""Writer of candump logs, the mirror of `candump.Candump`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ...schemas.store import publish
from .frames import FrameBatch
from .text_log import LONGEST_NAME

_CHUNK = 1 << 15


def write_candump(path: Path, batches: Iterable[FrameBatch]) -> int:
    """Publish frames as a `candump -L` log.

    Times have 6 digits behind the point, or 9 where there are nanoseconds to keep; flags of CAN FD are 0.

    Args:
        path: The log to write or replace.
        batches: Frames; `candump.Candump` reads the same ones back.

    Returns:
        How many frames were written.

    Raises:
        ValueError: A frame cannot be written: a negative time, an identifier beyond its bits, a payload or the name of
            an interface too long.
    """
    from .candump_lines import LONGEST_FRAME, write

    text = np.empty(_CHUNK * LONGEST_FRAME, np.uint8)
    frames = 0
    with publish(path) as draft, draft.open("wb") as log:
        for batch in batches:
            _check(batch, LONGEST_NAME)
            names = np.zeros((max(1, len(batch.channels)), 1 + LONGEST_NAME), np.uint8)
            for row, name in zip(names, batch.channels, strict=False):
                row[0] = len(name.encode())
                row[1 : 1 + row[0]] = np.frombuffer(name.encode(), np.uint8)
            columns = (
                batch.time,
                batch.channel,
                batch.id,
                batch.extended,
                batch.fd,
                batch.kind,
                batch.length,
                batch.data,
            )
            for start in range(0, len(batch), _CHUNK):
                size = write(*(column[start : start + _CHUNK] for column in columns), names, text)
                log.write(text[:size].data)
            frames += len(batch)
    return frames


def _check(batch: FrameBatch, longest_name: int) -> None:
    limit = np.where(batch.extended, 0x1FFFFFFF, 0x7FF)
    complaints = {
        "a time before 1970": (batch.time < 0).any(),
        "an identifier beyond 11 bits, or 29 where it is extended": (batch.id > limit).any(),
        "a payload of more than 8 bytes on a classic frame": (batch.length[~batch.fd] > 8).any(),
        "an interface whose name is empty, has blanks or is longer than 32 bytes": any(
            not name or name.split() != [name] or len(name.encode()) > longest_name for name in batch.channels
        ),
    }
    found = [complaint for complaint, there in complaints.items() if there]
    if found:
        raise ValueError(f"candump has no line for {'; '.join(found)}")
