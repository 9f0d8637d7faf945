"""Reader of MF4 bus logging (ASAM MDF 4), by asammdf in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, ClassVar

import pyarrow as pa

from ...schemas.errors import InputError
from ..account import KEPT_REJECTIONS, Account
from ..content import blocks, head
from .frames import FrameBatch

FINALISED, UNFINALISED = b"MDF     ", b"UnFinMF "


@dataclass(frozen=True, slots=True)
class Mf4:
    """A log of bus events in MDF 4: groups of records named CAN_DataFrame, CAN_RemoteFrame and CAN_ErrorFrame.

    It may be finalised or not (a logger that lost power), its data compressed or not, sorted or not. Times are the
    header's start plus the record's own; a header that says its start is local time without telling the zone is taken
    as if it were UTC. Channels are the numbers of the buses. Records of other buses (LIN, FlexRay) and overload frames
    have no place among CAN frames: they count as rejected, one entry for each group.

    asammdf comes with the extra `mf4`. It runs in `mf4_process`, so that its import, its memory and its crashes are not
    those of the process that reads.

    Attributes:
        path: The log; one that is compressed as a whole (gzip, Zstandard) is unpacked into a temporary folder first.
    """

    format: ClassVar[str] = "mf4"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether `head` begins with the identification block of MDF 4."""
        return head[:8] in {FINALISED, UNFINALISED} and head[8:10] == b"4."

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames of all groups in the order of time and count them in `account`.

        Groups are merged by time; within a group a record that is out of order by more than a piece of the file (2¹⁷
        records) stays where it is. Where a group holds fewer records than it counts the file is `truncated`.

        Raises:
            InputError: asammdf is not installed, or the file is missing, is no MDF 4, logs no CAN bus, or is damaged
                before its first frame.
        """
        start = head(self.path)
        if find_spec("asammdf") is None:
            raise InputError(self.path, "", 'is MF4, which asammdf reads; install it: pip install "wheelprint[mf4]"')
        with TemporaryDirectory(prefix="wheelprint-mf4-") as folder:
            path = self.path
            with path.open("rb") as file:
                plain = file.read(8) == start[:8]
            if not plain:
                path = Path(folder) / "unpacked.mf4"
                with path.open("wb") as file:
                    file.writelines(blocks(self.path, account))
            yield from self._frames(path, folder, account)

    def _frames(self, path: Path, folder: str, account: Account) -> Iterator[FrameBatch]:
        command = [sys.executable, "-m", "wheelprint.ingest.can.mf4_process", str(path), folder]
        # More threads would only hold memory.
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        with (Path(folder) / "stderr").open("wb+") as said:
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, env=environment)  # noqa: S603 (our own interpreter and module)
            assert process.stdout is not None  # noqa: S101 (for the type checker: it is a pipe)
            delivered, finished, refusal = 0, False, None
            try:
                for batch, notes in _messages(process.stdout):
                    refusal = notes.get("error", refusal)
                    finished |= "rejections" in notes
                    account.accepted += len(batch)
                    account.rejected += notes.get("rejected", 0)
                    account.truncated |= notes.get("truncated", False)
                    room = KEPT_REJECTIONS - len(account.rejections)
                    account.rejections.extend((where, why) for where, why in notes.get("rejections", ())[:room])
                    if len(batch):
                        delivered += len(batch)
                        yield FrameBatch.from_arrow(pa.Table.from_batches([batch]))
            except BaseException:
                process.kill()
                raise
            finally:
                process.stdout.close()
                code = process.wait()
            if refusal:
                raise InputError(self.path, "", refusal)
            if not finished:
                reason = f"asammdf {_ending(code, said)}: the file is damaged, or was cut off within its tables"
                if not delivered:
                    raise InputError(self.path, "", f"{reason}. Copy it again from where it was recorded")
                account.truncated = True
                account.reject("", f"{reason}; the {delivered} frames before were read")


def _messages(stream: IO[bytes]) -> Iterator[tuple[pa.RecordBatch, dict[str, Any]]]:
    """Yield the batches of an Arrow stream with their notes, up to where it breaks off."""
    try:
        with pa.ipc.open_stream(stream) as reader:
            while True:
                batch, notes = reader.read_next_batch_with_custom_metadata()
                yield batch, json.loads(notes[b"notes"]) if notes else {}
    except (StopIteration, pa.ArrowInvalid, OSError):
        # What is missing is seen by the missing last note.
        return


def _ending(code: int, said: IO[bytes]) -> str:
    """Tell how the process ended: what it was killed by, or the last line of what it said."""
    if code < 0:
        return f"ended by {signal.Signals(-code).name}" + (
            ", beyond the time that a file of this size needs" if -code == signal.SIGXCPU else ""
        )
    said.seek(0)
    lines = said.read()[-2000:].decode("utf-8", "replace").strip().splitlines()
    return f"failed with {lines[-1][:200]!r}" if lines else f"ended with code {code}"
