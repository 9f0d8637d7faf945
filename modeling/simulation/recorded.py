"""A simulated trip's signals as the readers give them, without the files of its bus: for measuring estimators."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from ...ingest.account import Account
from ...ingest.can.database import load_database
from ...ingest.can.decode import decode
from ...ingest.clock import ClockEstimate, to_utc
from ...ingest.mapping import resolve
from ...ingest.oxts.ncom import Ncom
from ...ingest.oxts.ncom_writer import write_ncom
from ...ingest.stored_signals import SampledSignal
from ...ingest.synchronise import synchronise
from ...schemas.config import Can
from ...schemas.signals import NAV_SIGNALS
from .campaign import Campaign, drive_trip
from .logs import DATABASE, MAPPING, can_log, navigation_log


class Recorded(NamedTuple):
    """What a trip's logs say, and what was.

    Attributes:
        can: Canonical signals, stamped by the CAN logger's clock.
        navigation: Navigation's signals.
        truth: In the schema `TRUTH`.
    """

    can: dict[str, SampledSignal]
    navigation: dict[str, SampledSignal]
    truth: pa.Table


def record_trip(campaign: Campaign, index: int) -> Recorded:
    """Drive a trip of a campaign, and return what its logs say.

    The bus's frames are those of `can_log` (payloads, stamps to 1 µs, gaps), decoded; only candump's text is left out,
    which holds the same. Navigation goes through a file in the format NCOM.

    Args:
        campaign: The trip's.
        index: Of the trip within the campaign, from 0.

    Raises:
        InputError: The trip is too short for its emergencies.
        IndexError: There is no such trip.
    """
    trip = campaign.trips[index]
    with tempfile.TemporaryDirectory() as folder:
        driven = drive_trip(Path(folder), campaign, index)
        on_bus, in_navigation = driven.generators
        database = load_database([DATABASE], Path(folder))
        frames = can_log(on_bus, driven.truth, campaign.car, campaign.sensors, trip.clock, trip.can_gaps, database)
        log = navigation_log(in_navigation, driven.truth, campaign.sensors, driven.origin, trip.nav_gaps)
        file = Path(folder) / "nav.ncom"
        write_ncom(file, **asdict(log))
        navigation = pa.Table.from_batches(list(Ncom(file).batches(Account())))
    messages = decode(frames, database)
    mapping, _ = resolve(Can.model_validate({"signals": MAPPING}), database, Path("wheelprint.toml"))
    can = {}
    for name, mapped in mapping.items():
        message = messages[mapped.message]
        values = message[mapped.column].cast(pa.float64()).to_numpy() * mapped.factor
        can[name] = SampledSignal(message["time"].cast(pa.int64()).to_numpy(), values)
    time = navigation["time"].cast(pa.int64()).to_numpy()
    measured = {
        name: SampledSignal(time, navigation[name].cast(pa.float64(), safe=False).to_numpy())
        for name in NAV_SIGNALS
        if navigation[name].null_count < len(navigation)
    }
    return Recorded(can, measured, driven.truth)


def synced_table(recorded: Recorded, clock: ClockEstimate, period: int, max_gap: int) -> pa.Table:
    """Return a trip's signals on the grid, in the schema `SYNCED`.

    Args:
        recorded: The trip.
        clock: What is known of the CAN logger's clock.
        period: ns between rows.
        max_gap: ns, the longest gap that is bridged.
    """
    can = {name: SampledSignal(to_utc(signal.time, clock), signal.values) for name, signal in recorded.can.items()}
    return synchronise({}, recorded.navigation | can, ClockEstimate.trusted("in UTC already"), period, max_gap)
