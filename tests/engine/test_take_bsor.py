"""The .bsor reader, on files that the test writes byte by byte."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.takes.bsor import MAGIC
from cbm_addon.takes.readers import read_take

FRAMES = 50
TIMES = np.arange(FRAMES) / 90


def text(value: str, length: int | None = None) -> bytes:
    data = value.encode()
    return struct.pack("<i", len(data) if length is None else length) + data


def header(player: bytes = text("player"), version: int = 1) -> bytes:
    before = b"".join(text(value) for value in ("0.6.0", "1.28", "0", "id"))
    after = b"".join(text(value) for value in ("steam", "OpenVR", "Quest 2", "Touch", "hash", "song", "mapper", "Hard"))
    last = struct.pack("<i", 1234) + text("Standard") + text("Nice") + text("") + struct.pack("<f?ffff", 20, False, 1.7, 0, 0, 0)
    return MAGIC + struct.pack("<B", version) + b"\0" + before + player + after + last


def frames() -> bytes:
    """A head at 1.7 m that looks to +Z, turned by 0.2 rad about +Y, and hands before it, the left one at -X."""
    turn = (0, np.sin(0.1), 0, np.cos(0.1))
    data = b"\1" + struct.pack("<i", FRAMES)
    for time in TIMES:
        data += struct.pack("<fi", time, 0)
        for place in ((0, 1.7, 0), (-0.3, 1.2, 0.4), (0.3, 1.2, 0.5)):
            data += struct.pack("<7f", *place, *turn)
    return data


@pytest.fixture
def path(tmp_path):
    return tmp_path / "replay"


def test_frames_become_engine_poses(path):
    path.write_bytes(header() + frames() + b"\2 notes, walls and the rest are not read")
    take = read_take(path)
    np.testing.assert_allclose(take.times, TIMES, atol=1e-6)
    np.testing.assert_allclose(take.positions[0], [[0, 0, 1.7], [0.3, -0.4, 1.2], [-0.3, -0.5, 1.2]], atol=1e-6)
    # In a left-handed frame a positive turn about +Y (up) goes from +Z to +X, to the right; about +Z in the engine it is negative.
    np.testing.assert_allclose(take.rotations[0, 0], [np.cos(0.1), 0, 0, -np.sin(0.1)], atol=1e-6)
    assert take.kind == "device"
    assert take.report.constants["device"].value == "saber"
    assert take.report.origin["headset"] == "Quest 2"
    assert "player" not in take.report.origin.values()


def test_a_name_whose_length_is_counted_in_utf16_units(path):
    name = "プレイヤー"
    path.write_bytes(header(player=text(name, length=len(name))) + frames())
    assert len(read_take(path)) == FRAMES
    assert read_take(path).report.origin["headset"] == "Quest 2"


def test_another_version_is_refused(path):
    path.write_bytes(header(version=2) + frames())
    with pytest.raises(InputError, match="version 2"):
        read_take(path)


@pytest.mark.parametrize("kept", [4, 5, 30, 100, len(header()), len(header()) + 3, len(header() + frames()) - 1])
def test_a_file_that_is_cut_off_is_refused(path, kept):
    path.write_bytes((header() + frames())[:kept])
    with pytest.raises(InputError, match="cut off"):
        read_take(path)


def test_a_wrong_block_is_refused(path):
    path.write_bytes(header() + b"\7" + frames())
    with pytest.raises(InputError, match="block 7"):
        read_take(path)
