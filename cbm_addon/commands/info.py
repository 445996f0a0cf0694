"""`info`: what a take or a mocap file is."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..console import Console
from ..errors import InputError
from .calibration import add_calibration_arguments, calibration_options, is_mocap, read_any_take

if TYPE_CHECKING:
    from ..motion.bvh import BvhFile
    from ..takes.calibrate import Calibration, CalibrationOptions
    from ..takes.recording import TakeOverrides
    from ..takes.take import Take, TakeReport

HELP = "say what takes and mocap files are: format, rate, unit, axes, floor, stature, gaps, defects"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="a take of any format, or mocap (BVH)")
    parser.add_argument("--table", action="store_true", help="one line a file, and files that cannot be read do not stop the others")
    parser.add_argument("--plot", type=Path, metavar="OUT.svg", help="draw the take before and after cleaning; of one file")
    add_calibration_arguments(parser)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    overrides, options = calibration_options(args)
    if args.plot:
        _plot(args, overrides, options)
    files = []
    for path in args.files:
        try:
            facts, lines = _file(path, overrides, options)
        except InputError as refusal:
            if not args.table:
                raise
            facts, lines = {"refused": refusal.message}, []
        files.append({"file": path, **facts})
        if not args.table:
            console.say(str(path))
            for line in lines:
                console.say(f"  {line}")
    if args.table:
        for line in _table(files):
            console.say(line)
    report: dict[str, Any] = {"files": files}
    if refused := sum("refused" in facts for facts in files):
        report["error"] = f"{refused} of {len(files)} files cannot be read; the last column says why"
    return report


def _file(path: Path, overrides: TakeOverrides, options: CalibrationOptions) -> tuple[dict[str, Any], list[str]]:
    """What a file is, and the same in words."""
    from ..motion.bvh import read_bvh_file
    from ..takes.calibrate import calibrate
    from ..takes.describe import take_lines

    if is_mocap(path, overrides):
        file = read_bvh_file(path)
        return _mocap_facts(file), list(_mocap_lines(file))
    take = read_any_take(path, overrides)
    assert take.report is not None
    calibration = calibrate(take, options).calibration
    return _take_facts(take, take.report, calibration), list(take_lines(take, calibration))


def _table(files: list[dict[str, Any]]) -> Iterator[str]:
    rows = [("file", "format", "samples", "seconds", "rate", "unit", "axes", "hands", "floor", "eyes", "what is wrong"), *map(_row, files)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def _row(facts: dict[str, Any]) -> tuple[str, ...]:
    name = Path(facts["file"]).name
    if "refused" in facts:
        return (name, *("-",) * 9, f"refused: {facts['refused']}")
    length = f"{facts['seconds']:.1f}", f"{facts['rate_hz']:.1f}"
    if facts["kind"] == "mocap":
        wrong = "; ".join(facts["warnings"]) or "-"
        return (name, "BVH of a body", str(facts["frames"]), *length, facts["unit"], f"{facts['up_axis']} up", "-", "-", "-", wrong)
    found = facts["constants"] | facts["calibration"]["constants"]
    axes, hands = found["axes"], found["swap_hands"]
    sure = "" if axes["confidence"] is None else f" {axes['confidence']:.2f}"
    wrong = [defect["kind"].replace("_", " ") for defect in facts["defects"]]
    values = [f"{found[key]['value']:.2f} {found[key]['source']}" for key in ("floor", "eye_height")]
    exchanged = "exchanged" if hands["value"] else "as named"
    return (name, facts["format"], str(facts["samples"]), *length, found["unit"]["value"], axes["value"] + sure, exchanged, *values, ", ".join(wrong) or "-")


def _plot(args: argparse.Namespace, overrides: TakeOverrides, options: CalibrationOptions) -> None:
    from ..outputs import replacing
    from ..takes.calibrate import calibrate, joint_poses
    from ..takes.plot import drawing

    if len(args.files) > 1:
        raise InputError("--plot", f"draws one take, not {len(args.files)} files")
    with replacing(args.plot, args.overwrite) as temporary:
        (path,) = args.files
        calibrated = calibrate(read_any_take(path, overrides), options)
        before = joint_poses(read_any_take(path, replace(overrides, keep_outliers=True, join_teleports=False)), calibrated.calibration)
        temporary.write_text(drawing(before, calibrated.take), encoding="utf-8")


def _take_facts(take: Take, report: TakeReport, calibration: Calibration) -> dict[str, Any]:
    from ..takes.take import DEVICES

    return {
        "kind": "take",
        "poses": take.kind,
        "samples": len(take),
        "seconds": take.seconds,
        "rate_hz": take.rate,
        "tracked": dict(zip(DEVICES, take.tracked.mean(axis=0), strict=True)),
        **asdict(report),
        "calibration": calibration.as_dict(),
    }


def _mocap_facts(file: BvhFile) -> dict[str, Any]:
    motion = file.motion
    return {
        "kind": "mocap",
        "format": "BVH",
        "frames": len(motion),
        "frames_declared": file.frames_declared,
        "seconds": motion.seconds,
        "rate_hz": 1 / file.frame_time,
        "joints": list(motion.skeleton.names),
        "channels": file.channels,
        "rotation_orders": file.rotation_orders,
        "moving_joints": file.moving_joints,
        "unit": file.unit,
        "unit_to_metres": file.unit_to_metres,
        "unit_reason": file.unit_reason,
        "up_axis": file.up_axis,
        "up_axis_reason": file.up_axis_reason,
        **_body_facts(file),
        "warnings": file.warnings,
    }


def _body_facts(file: BvhFile) -> dict[str, float]:
    """Stature in metres and the height of the lowest toe, where the joints have the engine's names."""
    skeleton = file.motion.skeleton
    if any(name not in skeleton for name in ("Head", "LeftToe", "RightToe")):
        return {}
    from ..takes.devices import HEAD_JOINT_SHARE

    toes = file.motion.positions()[:, skeleton.indices(["LeftToe", "RightToe"]), 2]
    return {"stature": skeleton.height_above_toes() / HEAD_JOINT_SHARE, "lowest_toe": float(toes.min())}


def _mocap_lines(file: BvhFile) -> Iterator[str]:
    motion = file.motion
    yield f"BVH: {len(motion)} frames, {motion.seconds:.2f} s, {1 / file.frame_time:.1f} a second, {len(motion.skeleton)} joints, {file.channels} channels"
    yield f"unit: {file.unit} ({file.unit_reason}); up: {file.up_axis} ({file.up_axis_reason}); rotations {', '.join(file.rotation_orders)}"
    if body := _body_facts(file):
        yield f"stature: about {body['stature']:.2f} m; lowest toe at {body['lowest_toe']:.3f} m"
    for warning in file.warnings:
        yield f"! {warning}"
