from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
import zstandard

from wheelprint.ingest import content
from wheelprint.ingest.account import Account
from wheelprint.ingest.content import blocks, head
from wheelprint.schemas.errors import InputError

TEXT = b"".join(b"(17155620%02d.%06d) can0 11F#%010X\n" % (n // 1000, n, n * n) for n in range(20_000))
COMPRESSED = {
    "plain": TEXT,
    "gzip": gzip.compress(TEXT, mtime=0),
    "gzip in two members": gzip.compress(TEXT[:777], mtime=0) + gzip.compress(TEXT[777:], mtime=0) + bytes(64),
    "zstd": zstandard.ZstdCompressor(write_checksum=True).compress(TEXT),
    "zstd in two frames": zstandard.compress(TEXT[:777]) + zstandard.compress(TEXT[777:]),
}


def read(path: Path, size: int = content.BLOCK) -> tuple[bytes, Account]:
    account = Account()
    return b"".join(blocks(path, account, size)), account


@pytest.mark.parametrize("form", COMPRESSED)
@pytest.mark.parametrize("size", [1000, 1 << 20])
def test_every_form_gives_the_same_content(form: str, size: int, tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(COMPRESSED[form])
    assert read(path, size) == (TEXT, Account())
    assert head(path) == TEXT[: content.HEAD]


@pytest.mark.parametrize("form", ["gzip", "zstd"])
def test_cut_anywhere_what_stands_before_arrives_and_the_cut_is_told(form: str, tmp_path: Path) -> None:
    packed = COMPRESSED[form]
    path = tmp_path / "log"
    for cut in np.linspace(4, len(packed) - 1, 60).astype(int).tolist():
        path.write_bytes(packed[:cut])
        got, account = read(path)
        assert TEXT.startswith(got)
        assert (account.truncated, account.rejected) == (True, 1)
        assert account.rejections[0][0] == f"byte {cut} of the compressed file"
    assert len(got) > 0.4 * len(TEXT)


@pytest.mark.parametrize("form", ["gzip", "zstd"])
def test_any_flipped_bit_is_found_or_harmless(form: str, tmp_path: Path) -> None:
    packed = bytearray(COMPRESSED[form])
    path = tmp_path / "log"
    for place in np.linspace(10, len(packed) - 1, 80).astype(int).tolist():
        packed[place] ^= 4
        path.write_bytes(packed)
        packed[place] ^= 4
        got, account = read(path)
        assert account.rejected or got == TEXT


def test_a_bomb_is_read_in_bounded_pieces(tmp_path: Path) -> None:
    path = tmp_path / "log"
    for bomb in (gzip.compress(bytes(200 << 20), 9, mtime=0), zstandard.compress(bytes(200 << 20), 19)):
        path.write_bytes(bomb)
        pieces = [len(piece) for piece in blocks(path, Account())]
        assert sum(pieces) == 200 << 20
        assert max(pieces) <= 32 << 20


def test_a_missing_file_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        head(tmp_path / "gone")
    assert str(error.value) == f"{tmp_path}/gone: no such file; check the path, or whether the disk is mounted"
