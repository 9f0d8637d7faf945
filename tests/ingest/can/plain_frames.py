"""Frames as plain values: what the tests of readers compare."""

from __future__ import annotations

from wheelprint.ingest.can.frames import KINDS, FrameBatch

Frame = tuple[int, str, int, bool, bool, str, str]
"""Time in ns, channel, identifier, extended, FD, kind, and the payload in hexadecimal."""


def frames_of(batch: FrameBatch) -> list[Frame]:
    """Return the frames of a batch, whose payloads must be padded with zeros."""
    for row, length in zip(batch.data, batch.length, strict=True):
        assert not row[length:].any(), "payloads are padded with zeros"
    return [
        (
            int(batch.time[i]),
            batch.channels[batch.channel[i]],
            int(batch.id[i]),
            bool(batch.extended[i]),
            bool(batch.fd[i]),
            KINDS[batch.kind[i]],
            batch.data[i, : batch.length[i]].tobytes().hex().upper(),
        )
        for i in range(len(batch))
    ]
