"""How logs lie in time to each other: what they have in common, what lies between them, and what looks wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

SECOND = 1_000_000_000
HOUR = 3600 * SECOND
YEAR = 365 * 24 * HOUR

LATEST_START = 300 * SECOND
"""ns; the logs of one drive are started within so much of each other."""
LEAST_COMMON = 0.8
"""Share of the shorter of two logs that a time zone's hours must bring together."""
ZONES = tuple(sorted((half * HOUR // 2 for half in range(-24, 29) if half), key=lambda s: (s % HOUR != 0, abs(s))))
"""ns; offsets of time zones from UTC, -12 h to +14 h, whole hours first."""


@dataclass(frozen=True, slots=True)
class LogSpan:
    """When a log was recorded, by its own stamps.

    Attributes:
        name: The log.
        kind: `can`, `nav` or `camera`.
        start: First stamp, ns.
        stop: Last stamp, ns.
    """

    name: str
    kind: str
    start: int
    stop: int

    def in_common(self, other: LogSpan) -> int:
        """Return the time in common, ns; negative: the time that lies between them."""
        return min(self.stop, other.stop) - max(self.start, other.start)


def near_each_other(logs: Iterable[LogSpan]) -> list[list[LogSpan]]:
    """Divide logs, in the order of time, where so much lies between them that one scale of time shows neither side.

    That is more than a minute and than three times what they span so far.
    """
    groups: list[list[LogSpan]] = []
    stop = 0
    for log in sorted(logs, key=lambda log: (log.start, log.stop, log.name)):
        if groups and log.start - stop <= max(60 * SECOND, 3 * (stop - groups[-1][0].start)):
            groups[-1].append(log)
            stop = max(stop, log.stop)
        else:
            groups.append([log])
            stop = log.stop
    return groups


def of_every_kind(logs: Sequence[LogSpan]) -> list[tuple[int, int]]:
    """Return the stretches in which there is a log of every kind that occurs, in the order of time, ns."""
    common: list[tuple[int, int]] | None = None
    for kind in sorted({log.kind for log in logs}):
        own = _union((log.start, log.stop) for log in logs if log.kind == kind)
        if common is None:
            common = own
        else:
            pairs = ((max(a[0], b[0]), min(a[1], b[1])) for a in common for b in own)
            common = _union(pair for pair in pairs if pair[0] < pair[1])
    return common or []


def _union(stretches: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    union: list[tuple[int, int]] = []
    for start, stop in sorted(stretches):
        if union and start <= union[-1][1]:
            union[-1] = union[-1][0], max(union[-1][1], stop)
        else:
            union.append((start, stop))
    return union


def time_zone(log: LogSpan, other: LogSpan) -> int | None:
    """Return the offset of a time zone that brings two logs without common time together.

    Returns:
        What `log` is ahead of `other`, ns: a whole or half number of hours; None where no such offset makes both start
        within five minutes of each other and have most of the shorter one in common.
    """
    for zone in ZONES:
        moved = LogSpan(log.name, log.kind, log.start - zone, log.stop - zone)
        shorter = max(min(log.stop - log.start, other.stop - other.start), 1)
        if abs(moved.start - other.start) <= LATEST_START and moved.in_common(other) >= LEAST_COMMON * shorter:
            return zone
    return None


def doubt(log: LogSpan, logs: Iterable[LogSpan]) -> str:
    """Return what is wrong with a log that has no time in common with any log of another kind; empty if nothing is."""
    others = [other for other in logs if other.kind != log.kind]
    if not others or any(log.in_common(other) > 0 for other in others):
        return ""
    for other in others:
        zone = time_zone(log, other)
        if zone is not None:
            hours = f"{abs(zone) / HOUR:g} hour{'' if abs(zone) == HOUR else 's'}"
            return (
                f"it has nothing in common with {other.name}, but {hours} {'earlier' if zone > 0 else 'later'} it "
                "would: the stamps of one of them may be local time"
            )
    if log.start < YEAR:
        return "its stamps begin in 1970: they count from the logger's own start and are no dates"
    dated = [other for other in others if other.start >= YEAR]
    if not dated:
        return ""
    nearest = max(dated, key=log.in_common)
    side = "ends" if nearest.stop <= log.start else "begins"
    apart, when = duration(-log.in_common(nearest)), "before it" if side == "ends" else "after it"
    return f"it has nothing in common with a log of another kind; the nearest, {nearest.name}, {side} {apart} {when}"


def duration(time: int) -> str:
    """Return a length of time as people say it: `12.3 s`, `4 min 05 s`, `3 h 20 min`, `17 days`."""
    seconds = time / SECOND
    if seconds < 60:
        return f"{seconds:.3g} s"
    if seconds < 3600:
        return f"{int(seconds // 60)} min {int(seconds % 60):02d} s"
    if seconds < 48 * 3600:
        return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d} min"
    days = seconds / 86400
    return f"{days:.0f} days" if days < 730 else f"{days / 365.2425:.1f} years"
