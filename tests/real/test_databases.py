"""Databases as people publish them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wheelprint.ingest.can.database import load_databases
from wheelprint.ingest.can.decode import decode
from wheelprint.ingest.can.frames import FrameBatch


def test_every_database_loads_whole(shared_data: Path) -> None:
    counts, repairs = {}, []
    for path in sorted(shared_data.glob("*/*.dbc")):
        database, problems = load_databases([path.name], path.parent)
        assert problems == []
        counts[path.name] = len(database.messages)
        repairs += [str(repair).removeprefix(f"{path}: ") for repair in database.repairs]
    assert counts == {
        "CSS-Electronics-SAE-J1939-DEMO.dbc": 2,
        "OBD-v4.4.dbc": 4,
        "canedge-internal-can9.dbc": 13,
        "canmod-gnss.dbc": 9,
        "canmod-gps.dbc": 9,
        "giulia.dbc": 37,
        "car.dbc": 4,
        "rav4.dbc": 50,
    }
    assert repairs == [
        "line 252: signals PCS_DUST and SET_ME_X10 of message PCS_HUD (0x411) overlap; both are kept",
        "line 252: signals PCS_TEMP and SET_ME_X10 of message PCS_HUD (0x411) overlap; both are kept",
        "line 252: signals FRD_ADJ and PCS_SENSITIVITY of message PCS_HUD (0x411) overlap; both are kept",
    ]


def test_a_j1939_database_matches_every_sender(shared_data: Path) -> None:
    database, _ = load_databases(["CSS-Electronics-SAE-J1939-DEMO.dbc"], shared_data / "canedge")
    assert [(m.name, m.j1939) for m in database.messages] == [("EEC1", True), ("CCVS1", True)]
    data = np.zeros((3, 8), np.uint8)
    data[:, 3:5] = np.frombuffer(np.array([6400, 8000, 1], "<u2").tobytes(), np.uint8).reshape(3, 2)
    frames = FrameBatch(
        time=np.arange(3),
        channel=np.zeros(3, np.int16),
        channels=("can0",),
        id=np.array([0x0CF00400, 0x18F00421, 0x0CF00300], np.uint32),
        extended=np.ones(3, bool),
        fd=np.zeros(3, bool),
        kind=np.zeros(3, np.uint8),
        length=np.full(3, 8, np.uint8),
        data=data,
    )
    tables = decode(frames, database)
    assert list(tables) == ["EEC1"]
    assert tables["EEC1"].select(["source", "EngineSpeed"]).to_pydict() == {
        "source": [0x00, 0x21],
        "EngineSpeed": [800.0, 1000.0],
    }
