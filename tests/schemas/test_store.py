from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wheelprint.schemas.errors import InputError
from wheelprint.schemas.store import Manifest, describe_output, publish, publish_table, publish_text, read_table
from wheelprint.schemas.tables import TIME


def table(n: int = 1000) -> pa.Table:
    return pa.table(
        {"time": pa.array(range(n), TIME), "speed": pa.array([0.1 * i for i in range(n)]), "name": ["x"] * n}
    )


def test_nothing_is_left_of_a_write_that_fails(tmp_path: Path) -> None:
    def write() -> None:
        with publish(tmp_path / "a" / "file") as draft:
            draft.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write()
    assert list((tmp_path / "a").iterdir()) == []


def test_the_old_file_stands_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "file"
    publish_text(path, "old")
    with publish(path) as draft:
        draft.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"


def test_tables_are_stored_as_the_design_says(tmp_path: Path) -> None:
    publish_table(tmp_path / "a.parquet", table())
    group = pq.ParquetFile(tmp_path / "a.parquet").metadata.row_group(0)
    columns = {group.column(i).path_in_schema: group.column(i) for i in range(group.num_columns)}
    assert {c.compression for c in columns.values()} == {"ZSTD"}
    assert "DELTA_BINARY_PACKED" in columns["time"].encodings
    assert not any("DICTIONARY" in encoding for encoding in columns["speed"].encodings)
    assert "BYTE_STREAM_SPLIT" in columns["speed"].encodings
    assert read_table(tmp_path / "a.parquet").equals(table())


def test_the_same_table_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        publish_table(tmp_path / name, table())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_flipped_bit_in_a_page_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    publish_table(path, table())
    content = bytearray(path.read_bytes())
    content[200] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a whole Parquet file"):
        read_table(path)


def test_the_manifest_confirms_only_what_stands(tmp_path: Path) -> None:
    manifest = Manifest(tmp_path)
    first, second = tmp_path / "first", tmp_path / "second"
    publish_text(first, "1")
    publish_text(second, "2")
    outputs = [describe_output(tmp_path, path) for path in (first, second)]
    manifest.record("recordings", "a/b", {"fingerprint": "f", "outputs": outputs})
    assert Manifest(tmp_path).is_current("recordings", "a/b", "f")
    assert not Manifest(tmp_path).is_current("recordings", "a/b", "g")

    manifest.record("recordings", "a/b", {"fingerprint": "f", "outputs": outputs[:1]})
    assert not second.exists()
    first.unlink()
    assert not Manifest(tmp_path).is_current("recordings", "a/b", "f")


def test_a_manifest_that_is_not_json_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(InputError, match="remove it and everything is done again"):
        Manifest(tmp_path)
