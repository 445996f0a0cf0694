"""A take and its calibration in words, for `info` and the panel."""

from __future__ import annotations

from collections.abc import Iterator

from .calibrate import Calibration
from .take import Constant, Take


def take_lines(take: Take, calibration: Calibration) -> Iterator[str]:
    """What was found, decided and assumed of a take that a reader made, a line each; what is wrong begins with "!"."""
    report = take.report
    assert report is not None
    yield f"{report.format}, {take.kind} poses: {len(take)} samples of {report.rows} rows, {take.seconds:.2f} s, {take.rate:.1f} a second"
    if report.origin:
        yield ", ".join(value for value in report.origin.values() if value)
    for name, constant in (report.constants | calibration.constants).items():
        yield f"{name.replace('_', ' ')}: {_constant_text(constant)}"
    if calibration.reach == calibration.reach:
        yield f"an arm reaches the wrists in {calibration.reach:.0%} of samples"
    for defect in report.defects:
        yield f"! {defect.message}"
    for warning in calibration.warnings:
        yield f"! {warning}"


def _constant_text(constant: Constant) -> str:
    value = constant.value
    if isinstance(value, bool):
        text = "yes" if value else "no"
    elif isinstance(value, float):
        text = f"{value:.3f} m"
    elif isinstance(value, tuple):
        text = ", ".join(f"{part:.3f}" for part in value) + " m"
    else:
        text = value
    sure = "" if constant.confidence is None else f", confidence {constant.confidence:.2f}"
    why = f": {constant.why}" if constant.why else ""
    return f"{text} ({constant.source}{sure}{why})"
