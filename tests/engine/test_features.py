"""The feature vectors: named, invariant to where and how large the person is, and the same for training and solving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.features import (
    CONTROL,
    LOWER_BODY,
    MODES,
    PROPORTIONS,
    TRACKERS,
    Frames,
    control_frames,
    lower_body_frames,
    network_input,
    proportions_of,
    tracker_frames,
)
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import multiply, quat_from_yaw, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.takes.synthesize import synthesize

LAYOUTS = {"trackers": TRACKERS, "control": CONTROL, "lower body": LOWER_BODY}


def moved(motion: Motion, yaw: float, shift: tuple[float, float]) -> Motion:
    """The motion somewhere else on the floor, facing elsewhere."""
    turn = quat_from_yaw(np.float32(yaw)).astype(np.float32)
    rotations = motion.rotations.copy()
    rotations[:, 0] = multiply(turn, rotations[:, 0])
    return replace(motion, root=rotate(turn, motion.root) + np.array([*shift, 0], np.float32), rotations=rotations)


def features(motion: Motion, mode: str) -> list[np.ndarray]:
    height = motion.skeleton.height_above_toes()
    trackers, anchors = tracker_frames(synthesize(motion), height)
    frames = np.arange(0, len(motion), 7)
    window = frames[:, None] + np.array(MODES[mode].window)
    sequence = frames[:, None] + np.array(MODES[mode].sequence)
    bodies = control_frames(motion, height), lower_body_frames(motion, height)
    return [trackers.seen_from(anchors[frames], window), *(body.seen_from(anchors[frames], sequence) for body in bodies)]


@pytest.mark.parametrize("mode", MODES)
def test_features_do_not_depend_on_place_and_heading(body_motion: Motion, mode: str) -> None:
    here, there = features(body_motion, mode), features(moved(body_motion, 2.1, (3.0, -5.0)), mode)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-4)


def test_features_do_not_depend_on_stature(body_motion: Motion) -> None:
    larger = replace(body_motion, skeleton=body_motion.skeleton.scaled(1.3), root=body_motion.root * np.float32(1.3))
    for a, b in zip(features(body_motion, "lookahead"), features(larger, "lookahead"), strict=True):
        contacts = a.shape[-1] == LOWER_BODY.size  # contact rules are in metres: they may differ
        np.testing.assert_allclose(a[..., :-4] if contacts else a, b[..., :-4] if contacts else b, atol=2e-4)


@pytest.mark.parametrize("name", LAYOUTS)
def test_what_an_anchor_sees_goes_back_to_the_world(body_motion: Motion, name: str) -> None:
    height = body_motion.skeleton.height_above_toes()
    trackers, anchors = tracker_frames(synthesize(body_motion), height)
    frames = {"trackers": trackers, "control": control_frames(body_motion, height), "lower body": lower_body_frames(body_motion, height)}[name]
    chosen = np.array([[3, 9, 20], [40, 41, 42]])
    vectors, scalars = Frames.to_world(frames.layout, frames.seen_from(anchors[chosen[:, 0]], chosen), anchors[chosen[:, 0]])
    np.testing.assert_allclose(vectors, frames.vectors[chosen], atol=1e-5)
    np.testing.assert_array_equal(scalars, frames.scalars[chosen])


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_every_number_has_a_name_of_its_own(layout) -> None:
    names = layout.names((-1, 0, 1))
    assert len(names) == 3 * layout.size
    assert len(set(names)) == len(names)


def test_the_causal_window_sees_nothing_later(body_motion: Motion) -> None:
    half = len(body_motion) // 2
    changed = body_motion.root.copy()
    changed[half + 1 :] += 1
    height = body_motion.skeleton.height_above_toes()
    window = np.array([[half]]) + np.array(MODES["causal"].window)
    seen = []
    for motion in (body_motion, replace(body_motion, root=changed)):
        trackers, anchors = tracker_frames(synthesize(motion), height)
        seen.append(trackers.seen_from(anchors[[half]], window))
    np.testing.assert_array_equal(*seen)


def test_proportions_are_those_of_the_body_whatever_its_size_and_place() -> None:
    found = dict(zip(PROPORTIONS, proportions_of(STANDARD_BODY), strict=True))
    # The standard body is that of Drillis and Contini (1966), in shares of stature; its head joint is at 0.907 of it above the toes.
    assert found["thigh"] == pytest.approx(0.232 / 0.907, abs=1e-3)
    assert found["shin"] == pytest.approx(0.231 / 0.907, abs=1e-3)
    assert found["hip.height"] == pytest.approx(found["thigh"] + found["shin"] + found["ankle.height"], abs=1e-5), "its legs are straight at rest"
    elsewhere = STANDARD_BODY.scaled(1.7)
    elsewhere.offsets[0] += (3, 4, 5)
    np.testing.assert_allclose(proportions_of(elsewhere), proportions_of(STANDARD_BODY), atol=1e-6)


def test_a_body_that_stands_higher_over_its_toe_joints_has_all_joints_higher() -> None:
    flat, raised = (
        dict(zip(PROPORTIONS, proportions_of(STANDARD_BODY, sole) * (1 + sole / STANDARD_BODY.height_above_toes()), strict=True)) for sole in (0, 0.05)
    )
    rise = 0.05 / STANDARD_BODY.height_above_toes()
    for name in PROPORTIONS:
        assert raised[name] - flat[name] == pytest.approx(rise if name.endswith(".height") else 0, abs=1e-5), name


def test_bodies_without_toes_or_shoulders_have_proportions_too() -> None:
    few = STANDARD_BODY.subset(tuple(name for name in STANDARD_BODY.names if not name.endswith(("Toe", "Shoulder"))))
    assert np.isfinite(proportions_of(few)).all()


def test_networks_see_windows_then_proportions() -> None:
    windows, proportions = np.zeros((2, 3, TRACKERS.size), np.float32), np.arange(len(PROPORTIONS), dtype=np.float32)
    seen = network_input(windows, proportions)
    assert (seen[:, : 3 * TRACKERS.size] == 0).all()
    np.testing.assert_array_equal(seen[:, 3 * TRACKERS.size :], [proportions] * 2)
    np.testing.assert_array_equal(network_input(windows, np.stack([proportions] * 2)), seen)
