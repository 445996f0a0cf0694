"""The Virtual Motion Capture protocol (protocol.vmc.info): poses of devices as OSC messages over UDP, recorded as a take.

    /VMC/Ext/Hmd/Pos/Local  /VMC/Ext/Con/Pos/Local   serial, position x y z, rotation x y z w: as tracked (since 2.3)
    /VMC/Ext/Hmd/Pos        /VMC/Ext/Con/Pos         the same, scaled to the sender's avatar
    /VMC/Ext/T              the sender's time, seconds

Unity's axes, metres. Which controller is which hand is told by its serial where that names a side, and measured otherwise.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..progress import Progress
from .names import find_devices
from .recording import Recording, TakeOverrides, take_from
from .take import HEAD, LEFT, RIGHT, Constant, Defect, Take
from .tracks import Track, at_head_times, track

NAME = "VMC protocol"
HOST, PORT = "127.0.0.1", 39539
POSE = re.compile(r"/VMC/Ext/(Hmd|Con)/Pos(/Local)?")
TIME = "/VMC/Ext/T"

PATIENCE = 0.25  # seconds to wait for a packet before looking at the clock
LARGEST_DATAGRAM = 65535  # bytes


@dataclass(frozen=True)
class _Sample:
    """A pose, x y z and x y z w, when it arrived and when the sender says it was, seconds."""

    arrived: float
    sent: float | None
    pose: tuple[float, ...]


class VmcRecorder:
    """Collects what one sender sends, packet by packet."""

    def __init__(self) -> None:
        self.head_poses = 0
        self._sent: float | None = None
        self._samples: dict[tuple[str, bool, str], list[_Sample]] = {}  # by kind, whether as tracked, and serial

    def receive(self, arrived: float, messages: Sequence[tuple[str, Sequence]]) -> None:
        """Takes in the messages (address, arguments) of a packet that arrived at that time, seconds of any clock. What is no pose and no
        time, or not as the protocol has it, is passed over."""
        times = [arguments[0] for address, arguments in messages if address == TIME and arguments and isinstance(arguments[0], float)]
        self._sent = times[-1] if times else self._sent
        for address, arguments in messages:
            found = POSE.fullmatch(address)
            if found and len(arguments) >= 8 and isinstance(arguments[0], str) and all(isinstance(value, float) for value in arguments[1:8]):
                kind, local = found.groups()
                sample = _Sample(arrived, self._sent, tuple(arguments[1:8]))
                self._samples.setdefault((kind, local is not None, arguments[0]), []).append(sample)
                self.head_poses += kind == "Hmd"

    def take(self, path: Path, overrides: TakeOverrides) -> Take:
        """The take of what has been received, to be written to `path`; InputError if no headset was there."""
        return take_from(self._recording(path), path, overrides)

    def _recording(self, path: Path) -> Recording:
        local = any(as_tracked for kind, as_tracked, _ in self._samples if kind == "Hmd")
        samples = {(kind, serial): found for (kind, as_tracked, serial), found in self._samples.items() if as_tracked == local}
        headset = next((serial for kind, serial in samples if kind == "Hmd"), None)
        if headset is None:
            raise InputError(path, "no headset was received; the sender must send the transforms of devices (/VMC/Ext/Hmd/Pos)")
        controllers = sorted(serial for kind, serial in samples if kind == "Con")
        devices = {HEAD: samples["Hmd", headset]} | {hand: samples["Con", serial] for hand, serial in _hands(controllers).items()}
        by_sender = len({sample.sent for sample in devices[HEAD]}) > len(devices[HEAD]) / 2
        times, positions, rotations = at_head_times({device: _track(own, by_sender) for device, own in devices.items()})
        scaled = Defect("avatar_scale", len(times), "poses are scaled to the sender's avatar (there is no …/Pos/Local): give the eye height (--eye-height)")
        return Recording(
            format=NAME,
            times=times,
            positions=positions,
            rotations=rotations,
            axes="unity",
            unit="m",
            origin={"headset": headset, "controllers": ", ".join(controllers)},
            constants={
                "time": Constant("the sender's clock", "format") if by_sender else Constant("arrival", "assumed", "the sender tells no time"),
                "device": Constant("index", "assumed", "the protocol passes on what SteamVR gives"),
            },
            defects=() if local else (scaled,),
        )


def _hands(serials: list[str]) -> dict[int, str]:
    """The controllers that are the left and the right hand: by the names of their sides, else the first two as they come."""
    named = find_devices(serials)
    hands = {hand: serials[named[side]] for hand, side in ((LEFT, "left"), (RIGHT, "right")) if side in named}
    free = [serial for serial in serials if serial not in hands.values()]
    return hands | dict(zip([hand for hand in (LEFT, RIGHT) if hand not in hands], free, strict=False))


def _track(samples: list[_Sample], by_sender: bool) -> Track:
    times = np.array([sample.sent if by_sender else sample.arrived for sample in samples], dtype=np.float64)
    poses = np.array([sample.pose for sample in samples], dtype=np.float64)
    timed = np.isfinite(times)
    return track(times[timed], poses[timed, :3], poses[timed][:, [6, 3, 4, 5]])


def listen(host: str, port: int) -> socket.socket:
    """A UDP socket that receives at that address. InputError if it cannot be had."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiver.bind((host, port))
    except (OSError, OverflowError) as error:
        receiver.close()
        raise InputError(f"{host}:{port}", f"cannot be listened at ({error}); end what listens there, or give another --host or --port") from None
    return receiver


def record(receiver: socket.socket, recorder: VmcRecorder, seconds: float | None) -> Generator[Progress, None, None]:
    """Feeds a recorder from a UDP socket, for `seconds` from the first pose of a headset on, or without one; None: until the job is stopped.

    InputError if python-osc is not installed.
    """
    try:
        from pythonosc.osc_packet import OscPacket, ParseError
    except ModuleNotFoundError:
        raise InputError("python-osc", "is not installed, and takes are received with it; `pip install python-osc`") from None
    receiver.settimeout(PATIENCE)
    began = time.monotonic()
    while (lasted := time.monotonic() - began) < (seconds or float("inf")):
        message = f"{recorder.head_poses} poses of the headset" if recorder.head_poses else "waiting for a headset"
        yield Progress(lasted / seconds if seconds else 0.0, message)
        try:
            datagram = receiver.recv(LARGEST_DATAGRAM)
            messages = [(timed.message.address, timed.message.params) for timed in OscPacket(datagram).messages]
        except (TimeoutError, ParseError):
            continue
        waiting = not recorder.head_poses
        recorder.receive(time.monotonic(), messages)
        if waiting and recorder.head_poses:
            began = time.monotonic()
