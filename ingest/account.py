"""What a reader says of a file: how many records it took, which it could not, and why; what else there is to say."""

from __future__ import annotations

from dataclasses import dataclass, field

KEPT_REJECTIONS = 100


@dataclass(slots=True)
class Account:
    """The count of a file's records, filled while the file is read.

    Attributes:
        accepted: Records that were passed on.
        rejected: Records, or stretches of bytes between records, that were not.
        truncated: The file ends within a record.
        rejections: The first hundred rejected ones: place (`line 17`, `byte 1440`) and reason.
        remarks: What has to be known of the file though it costs no record: place, empty if it is the whole file, and
            what there is to say.
        bytes_read: Of the file so far, as it is stored; 0 where the reader cannot tell.
    """

    accepted: int = 0
    rejected: int = 0
    truncated: bool = False
    rejections: list[tuple[str, str]] = field(default_factory=list)
    remarks: list[tuple[str, str]] = field(default_factory=list)
    bytes_read: int = field(default=0, compare=False)

    def reject(self, where: str, reason: str) -> None:
        """Count one rejected record; its place and reason are kept while there are fewer than a hundred."""
        self.rejected += 1
        if len(self.rejections) < KEPT_REJECTIONS:
            self.rejections.append((where, reason))
