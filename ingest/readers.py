"""The table of readers, and finding the one a file belongs to by its content."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol, cast

from ..schemas.errors import InputError
from .account import Account
from .can.asc import Asc
from .can.blf import Blf
from .can.candump import Candump
from .can.candump_console import CandumpConsole
from .can.crtd import Crtd
from .can.gvret_csv import GvretCsv
from .can.mf4 import Mf4
from .can.pcap import Pcap
from .can.python_can_csv import PythonCanCsv
from .can.trc import Trc
from .content import head
from .mcap_frames import McapFrames
from .mcap_navigation import McapNavigation
from .nmea import Nmea
from .oxts.kitti import Kitti
from .oxts.ncom import Ncom
from .oxts.oxts_csv import OxtsCsv
from .oxts.xcom import Xcom

if TYPE_CHECKING:
    import pyarrow as pa

    from .can.frames import FrameBatch


class Reader(Protocol):
    """What reads one format: small, picklable, without open files.

    Attributes:
        format: Name of the format.
        kind: `can`: `batches` yields `FrameBatch`; `nav`: it yields record batches in the schema `NAVIGATION`.
    """

    format: ClassVar[str]
    kind: ClassVar[str]

    def __init__(self, path: Path) -> None: ...

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell from the first 64 KiB, decompressed, whether the file is of this format."""
        ...


class FrameReader(Reader, Protocol):
    """A reader of CAN frames."""

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file, counting every record in `account`."""
        ...


class NavigationReader(Reader, Protocol):
    """A reader of navigation."""

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the samples in the order of time, counting every record in `account`."""
        ...


READERS: tuple[type[FrameReader | NavigationReader], ...] = (
    Asc,
    Blf,
    Candump,
    CandumpConsole,
    Crtd,
    GvretCsv,
    McapFrames,
    Mf4,
    Pcap,
    PythonCanCsv,
    Trc,
    Kitti,
    McapNavigation,
    Ncom,
    Nmea,
    OxtsCsv,
    Xcom,
)
"""Every reader; a new one is a line here (and passes the compliance tests)."""


def recognise(path: Path) -> tuple[Reader, ...]:
    """Return the readers of the format that the content of a file is of: one for each kind of record it may hold.

    Raises:
        InputError: The file is missing, unreadable or empty, or no format claims it, or more than one does.
    """
    start = head(path)
    if not start:
        reason = "holds nothing: empty, or gzip damaged from its start; the logger may have been stopped too early"
        raise InputError(path, "", reason)
    claims = [reader for reader in READERS if reader.sniff(start)]
    formats = sorted({reader.format for reader in claims})
    if len(formats) == 1:
        return tuple(reader(path) for reader in claims)
    if claims:
        raise InputError(path, "", f"looks like {' and '.join(formats)} at once; keep one kind of record in a file")
    known = ", ".join(sorted({reader.format for reader in READERS}))
    raise InputError(
        path,
        "",
        f"is of no format that is known here ({known}); it begins with {start[:24]!r}. Export it as one of these",
    )


def formats_of(path: Path) -> list[str]:
    """Return the formats that claim a file by its content.

    Raises:
        InputError: The file is missing or unreadable.
    """
    start = head(path)
    return sorted({reader.format for reader in READERS if reader.sniff(start)})


def read_frames(path: str | Path) -> pa.Table:
    """Read a CAN log of any known format.

    Args:
        path: The log.

    Returns:
        All frames in the order of the file, in the schema `FRAMES`: `time` (ns, UTC as far as the logger knew),
        `channel`, `id`, `extended`, `fd`, `kind` (data, remote, error), `data`. The schema's metadata holds the
        account: `format`, `accepted`, `rejected`, `truncated`.

    Raises:
        InputError: The file is missing or is not a CAN log.
    """
    import pyarrow as pa

    from ..schemas.tables import FRAMES

    reader = cast("FrameReader", _of_kind(Path(path), "can"))
    account = Account()
    batches = [batch.to_arrow() for batch in reader.batches(account)]
    return pa.Table.from_batches(batches, FRAMES).replace_schema_metadata(_account(reader, account))


def read_nav(path: str | Path) -> pa.Table:
    """Read a navigation log of any known format.

    Args:
        path: The log.

    Returns:
        The navigation vocabulary at the log's own rate, in the schema `NAVIGATION`: metres east and north of
        `origin` (in the schema's metadata, JSON), degrees anticlockwise from east, positive to the left; null where
        the unit did not know. The metadata holds the account too: `format`, `accepted`, `rejected`, `truncated`.

    Raises:
        InputError: The file is missing, is not a navigation log, or its time cannot be known.
    """
    import pyarrow as pa

    from ..schemas.tables import NAVIGATION

    reader = cast("NavigationReader", _of_kind(Path(path), "nav"))
    account = Account()
    batches = list(reader.batches(account))
    schema = batches[0].schema if batches else NAVIGATION
    table = pa.Table.from_batches(batches, schema)
    return table.replace_schema_metadata({**(schema.metadata or {}), **_account(reader, account)})


def _account(reader: Reader, account: Account) -> dict[str, str]:
    return {
        "format": reader.format,
        "accepted": str(account.accepted),
        "rejected": str(account.rejected),
        "truncated": str(account.truncated).lower(),
    }


def _of_kind(path: Path, kind: Literal["can", "nav"]) -> Reader:
    readers = recognise(path)
    for reader in readers:
        if reader.kind == kind:
            return reader
    wanted, other = ("a CAN log", "read_nav") if kind == "can" else ("a navigation log", "read_frames")
    raise InputError(path, "", f"is {readers[0].format}, not {wanted}; `wheelprint.{other}` reads it")
