"""The VMC receiver, with packets that the test writes from the OSC 1.0 specification and sends over UDP."""

from __future__ import annotations

import _thread
import json
import signal
import socket
import struct
import threading
import time

import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import difference, matrix_from_quat, quat_from_matrix
from cbm_addon.takes.frames import AXES
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.recording import TakeOverrides
from cbm_addon.takes.sample_motion import sample_take
from cbm_addon.takes.vmc import PATIENCE, VmcRecorder, listen, record

SAMPLE = sample_take()
COUNT = 120
C = AXES["unity"]
PLACES = SAMPLE.positions[:COUNT].astype(np.float64) @ C
TURNS = quat_from_matrix(C.T @ matrix_from_quat(SAMPLE.rotations[:COUNT].astype(np.float64)) @ C)[..., [1, 2, 3, 0]]
SERIALS = ("LHR-HMD", "LHR-1111", "LHR-2222")
EVERYTHING = TakeOverrides(swap_hands=False)


def osc_string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return data + b"\0" * (-len(data) % 4)


def message(address: str, *arguments: str | float | int) -> bytes:
    """An OSC message: address, type tags, big-endian arguments, each padded to four bytes."""
    tags = {str: "s", float: "f", int: "i"}
    parts = {str: osc_string, float: lambda value: struct.pack(">f", value), int: lambda value: struct.pack(">i", value)}
    return (
        osc_string(address) + osc_string("," + "".join(tags[type(value)] for value in arguments)) + b"".join(parts[type(value)](value) for value in arguments)
    )


def bundle(*messages: bytes) -> bytes:
    """An OSC bundle for now."""
    return osc_string("#bundle") + struct.pack(">Q", 1) + b"".join(struct.pack(">i", len(data)) + data for data in messages)


def pose(kind: str, serial: str, row: int, device: int, local: str = "/Local", scale: float = 1.0) -> bytes:
    values = [float(value) for value in (*PLACES[row, device] * scale, *TURNS[row, device])]
    return message(f"/VMC/Ext/{kind}/Pos{local}", serial, *values)


def frame(row: int, serials=SERIALS, local: str = "/Local") -> bytes:
    """What a sender sends of one frame, among it what does not matter here."""
    return bundle(
        message("/VMC/Ext/OK", 1),
        pose("Hmd", serials[0], row, 0, local),
        *(pose("Con", serial, row, device, local) for device, serial in enumerate(serials[1:], start=1)),
        message("/VMC/Ext/Blend/Val", "Joy", 0.5),
        message("/VMC/Ext/T", float(5 + row / 72)),
    )


def send(port: int, packets: list[bytes], after=lambda: None) -> threading.Thread:
    """Sends packets to this machine, one every two milliseconds, without waiting for it."""

    def deliver() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for packet in packets:
                sender.sendto(packet, ("127.0.0.1", port))
                time.sleep(0.002)
        after()

    thread = threading.Thread(target=deliver)
    thread.start()
    return thread


def received(tmp_path, packets: list[bytes], overrides: TakeOverrides = TakeOverrides()):  # noqa: B008
    """The take of what arrives of these packets: recorded until they are sent and nothing comes any more."""
    recorder = VmcRecorder()
    with listen("127.0.0.1", 0) as receiver:
        thread = send(receiver.getsockname()[1], packets)
        before = time.monotonic()
        for _ in record(receiver, recorder, None):
            waited, before = time.monotonic() - before, time.monotonic()
            if waited > 0.8 * PATIENCE and not thread.is_alive():
                break
    return recorder.take(tmp_path / "live.csv", overrides)


def assert_same(take) -> None:
    """But for the float32 of the sender's clock, and packets that the network lost."""
    assert len(take) > 0.8 * COUNT
    rows = np.searchsorted(SAMPLE.times, take.times + SAMPLE.times[1] / 2) - 1
    np.testing.assert_allclose(take.times, SAMPLE.times[rows], atol=1e-5)
    np.testing.assert_allclose(take.positions, SAMPLE.positions[rows], atol=1e-5)
    assert difference(take.rotations, SAMPLE.rotations[rows]).max() < 1e-3


def test_bundles_become_a_take(tmp_path):
    take = received(tmp_path, [frame(row) for row in range(COUNT)])
    assert_same(take)
    assert take.report.constants["axes"].value == "unity"
    assert take.report.constants["time"].value == "the sender's clock"
    assert take.report.origin["headset"] == "LHR-HMD"


def test_messages_of_their_own_become_the_same_take(tmp_path):
    packets = []
    for row in range(COUNT):
        packets += [message("/VMC/Ext/T", float(row / 72)), pose("Hmd", "h", row, 0), pose("Con", "a", row, 1), pose("Con", "b", row, 2)]
    assert_same(received(tmp_path, packets))


def test_hands_are_told_by_their_names_or_measured(tmp_path):
    exchanged = [bundle(pose("Hmd", "h", row, 0), pose("Con", "a", row, 2), pose("Con", "b", row, 1), message("/VMC/Ext/T", row / 72)) for row in range(COUNT)]
    take = received(tmp_path, exchanged)
    assert take.report.constants["swap_hands"].value
    assert_same(take)
    named = [frame(row, ("h", "RightHand", "LeftHand")) for row in range(COUNT)]
    by_name = received(tmp_path, named, EVERYTHING)
    np.testing.assert_allclose(by_name.positions[0], SAMPLE.positions[0, [0, 2, 1]], atol=1e-5)


def test_poses_as_tracked_are_preferred_to_those_of_the_avatar(tmp_path):
    both = [bundle(pose("Hmd", "h", row, 0, "", 2.0), pose("Hmd", "h", row, 0), message("/VMC/Ext/T", row / 72)) for row in range(COUNT)]
    take = received(tmp_path, both)
    np.testing.assert_allclose(take.positions[:, 0].max(), SAMPLE.positions[:COUNT, 0].max(), atol=1e-4)
    assert not [defect for defect in take.report.defects if defect.kind == "avatar_scale"]
    scaled = received(tmp_path, [frame(row, local="") for row in range(COUNT)])
    assert [defect for defect in scaled.report.defects if defect.kind == "avatar_scale"]


def test_without_a_clock_the_time_of_arrival_counts(tmp_path):
    packets = [bundle(pose("Hmd", "h", row, 0), pose("Con", "a", row, 1)) for row in range(COUNT)]
    take = received(tmp_path, packets, TakeOverrides(keep_outliers=True))  # they are sent faster than anybody moves
    assert take.report.constants["time"].source == "assumed"
    assert 0.1 < take.seconds < 2.5
    assert take.tracked[:, 0].all()


def test_what_is_not_as_the_protocol_has_it_is_passed_over(tmp_path):
    noise = [b"", b"no OSC at all", message("/VMC/Ext/Hmd/Pos/Local", "h", 1.0), message("/VMC/Ext/Hmd/Pos/Local", *[1.0] * 8), message("/VMC/Ext/T", 3)]
    assert_same(received(tmp_path, [packet for row in range(COUNT) for packet in (noise[row % len(noise)], frame(row))]))


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_the_command_writes_a_take(tmp_path, capsys):
    port = free_port()
    threading.Timer(0.5, send, (port, [frame(row) for row in range(COUNT)])).start()
    command = ["record", "-o", str(tmp_path / "live.csv"), "--port", str(port), "--seconds", "5", "--quiet", "--json", str(tmp_path / "report.json")]
    assert main(command) == 0
    assert "samples" in capsys.readouterr().out
    assert_same(read_take(tmp_path / "live.csv"))
    assert json.loads((tmp_path / "report.json").read_text())["rate_hz"] == pytest.approx(72, abs=0.5)


@pytest.fixture
def heeds_ctrl_c():
    """What shells start in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeds_ctrl_c")
def test_ctrl_c_ends_a_recording_and_keeps_it(tmp_path):
    port = free_port()

    def interrupt() -> None:
        time.sleep(1)  # until what was sent is received
        _thread.interrupt_main()

    threading.Timer(0.5, send, (port, [frame(row) for row in range(COUNT)], interrupt)).start()
    assert main(["record", "-o", str(tmp_path / "live.csv"), "--port", str(port), "--quiet"]) == 0
    assert_same(read_take(tmp_path / "live.csv"))


def test_silence_and_a_port_in_use_are_said(tmp_path, capsys):
    port = free_port()
    assert main(["record", "-o", str(tmp_path / "live.csv"), "--port", str(port), "--seconds", "0.3", "--quiet"]) == 2
    assert "no headset was received" in capsys.readouterr().err
    with listen("127.0.0.1", port), pytest.raises(InputError, match="cannot be listened at"):
        listen("127.0.0.1", port)
    assert list(tmp_path.iterdir()) == []


def test_only_this_machine_is_listened_to_unless_told_otherwise():
    from cbm_addon.cli import build_parser

    assert build_parser().parse_args(["record", "-o", "take.csv"]).host == "127.0.0.1"
