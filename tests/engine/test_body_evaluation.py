"""The evaluation of body avoidance: its scenes are what they say, its figures measure what they name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.body.contact import planted_feet
from cbm_addon.cli import main
from cbm_addon.evaluate.body.measures import measured, summed
from cbm_addon.evaluate.body.methods import gradient
from cbm_addon.evaluate.body.picture import SIZE, before_and_after
from cbm_addon.evaluate.body.scenes import HEIGHT, KINDS, SECONDS, STANDING, TOUCHED, Scene, scene, scenes
from cbm_addon.features import RATE
from cbm_addon.hands.shapes import HalfSpace
from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import frame_times, resample
from cbm_addon.motion.rotations import matrix_from_quat
from cbm_addon.progress import run
from cbm_addon.takes.sample_motion import sample_motion


@pytest.fixture(scope="module")
def clip() -> Motion:
    """Three seconds of a walk."""
    return resample(sample_motion(), frame_times(2.5, 5.5, RATE))


@pytest.fixture(scope="module", params=KINDS)
def put(request: pytest.FixtureRequest, clip: Motion) -> tuple[str, Scene]:
    found = scene("walk", clip, request.param, np.random.default_rng(1))
    assert found, "a walk has room for every kind"
    return request.param, found


@pytest.fixture(scope="module")
def ball(clip: Motion) -> Scene:
    found = scene("walk", clip, "ball", np.random.default_rng(1))
    assert found
    return found


def surface_depths(scene: Scene, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """How deep the points on the axes are inside, [T, M], and their parts' surface there."""
    rotations, positions = motion.forward()
    joints, offsets = scene.shape.axes.joints, scene.shape.axes.offsets
    points = np.einsum("tmij,mj->tmi", matrix_from_quat(rotations)[:, joints], offsets) + positions[:, joints]
    distances = scene.solid.nearest(points.reshape(-1, 3).astype(np.float32))[0].reshape(points.shape[:2])
    return -distances, scene.shape.radii - distances


def test_a_solid_enters_the_body_by_as_much_as_its_kind_allows(put: tuple[str, Scene]) -> None:
    kind, scene = put
    axes, depths = surface_depths(scene, scene.motion)
    share = (depths.max(-1) > 0).mean()
    assert TOUCHED[0] - 0.02 < share < TOUCHED[1] + 0.02
    assert 0.005 < depths.max() < 0.3
    assert axes.max() < KINDS[kind][2] + 0.02, "frames between those that were looked at may be a little deeper"


def test_feet_that_stand_are_free(put: tuple[str, Scene]) -> None:
    _, scene = put
    depths, planted = surface_depths(scene, scene.motion)[1], planted_feet(scene.motion)
    assert planted.any()
    for foot in range(2):
        assert depths[planted[:, foot]][:, scene.shape.feet[foot]].max() < -STANDING + 0.01


def test_every_clip_is_an_adult_of_at_most_eight_seconds() -> None:
    motion = sample_motion()
    child = Motion(motion.skeleton.scaled(0.6), motion.times, motion.root * np.float32(0.6), motion.rotations)
    made = next(scenes([("child", resample(child, frame_times(0, 12, RATE)))]))
    assert made.shape.unit == pytest.approx(HEIGHT, abs=1e-5)
    assert made.motion.seconds <= SECONDS
    assert made.motion.positions()[:, made.motion.skeleton.index("Head"), 2].max() == pytest.approx(HEIGHT, rel=0.05)


def test_kinds_take_turns_and_the_same_seed_gives_the_same_scenes(clip: Motion) -> None:
    clips = [(f"clip{i}", clip) for i in range(3)]
    first, again, other = (list(scenes(clips, seed)) for seed in (0, 0, 1))
    assert [scene.name for scene in first] == [f"{kind}: clip{i}" for i, kind in enumerate(list(KINDS)[:3])]
    points = clip.positions().reshape(-1, 3)
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.solid.nearest(points)[0], two.solid.nearest(points)[0])
    assert np.abs(first[0].solid.nearest(points)[0] - other[0].solid.nearest(points)[0]).max() > 0.01


def test_where_there_is_no_room_there_is_no_scene(clip: Motion) -> None:
    """A single pose pierces always or never."""
    pose = Motion(clip.skeleton, clip.times[:1], clip.root[:1], clip.rotations[:1])
    assert scene("pose", pose, "ball", np.random.default_rng(0)) is None
    assert not list(scenes([("pose", pose)]))


def test_the_recorded_motion_has_not_moved(put: tuple[str, Scene]) -> None:
    _, scene = put
    row = measured(scene, scene.motion)
    assert row.planted.max() == 0
    assert row.trackers.max() == 0
    assert row.jitter == 1
    assert row.volume.max() > 0
    np.testing.assert_allclose(row.depth, np.maximum(surface_depths(scene, scene.motion)[1].max(-1), 0), atol=1e-4)
    figures = summed([row], [row])
    assert figures["reduced_percent"] == 0
    assert figures["near_tracker_percent"] == 100
    assert figures["frames"] == len(scene.motion)
    assert figures["pierced_percent"] == pytest.approx(100 * (row.depth > 0.01).mean())


def test_a_body_that_is_swallowed_has_all_its_volume_inside(ball: Scene) -> None:
    everything = replace(ball, solid=HalfSpace(np.array([0, 0, 5.0]), np.array([0, 0, 1.0])))
    row = measured(everything, ball.motion)
    np.testing.assert_allclose(row.volume, 1000 * ball.shape.volumes.sum(), rtol=1e-9)
    assert (row.depth > 3).all()
    assert len(row.trackers) == 0, "none is free"


def test_a_body_that_is_carried_away_has_moved_by_that(ball: Scene) -> None:
    away = replace(ball.motion, root=ball.motion.root + np.array([0, 0, 3], np.float32))
    row = measured(ball, away)
    np.testing.assert_allclose(row.planted, 3, atol=1e-5)
    np.testing.assert_allclose(row.trackers, 3, atol=1e-5)
    assert row.depth.max() == 0
    assert row.volume.max() == 0
    assert row.jitter == pytest.approx(1, abs=0.01)
    assert summed([row], [measured(ball, ball.motion)])["reduced_percent"] == 100


def test_the_baseline_frees_each_frame_by_itself(ball: Scene) -> None:
    before, after = measured(ball, ball.motion), measured(ball, run(gradient(ball)))
    assert after.volume.sum() < 0.2 * before.volume.sum()
    assert np.percentile(after.planted, 90) < 0.01


def test_a_picture_shows_both_bodies(ball: Scene) -> None:
    frame = int(measured(ball, ball.motion).volume.argmax())
    picture = before_and_after(ball, ball.motion, frame)
    assert picture.shape == (SIZE, 2 * SIZE, 3)
    np.testing.assert_array_equal(picture[:, :SIZE], picture[:, SIZE:])
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


def test_the_command_measures_our_own_clip_and_writes_its_files(clip: Motion, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_bvh(tmp_path / "walk.bvh", clip)
    words = ["evaluate", str(tmp_path / "walk.bvh"), "--body", "--report", str(tmp_path / "report"), "--json", str(tmp_path / "found.json")]
    assert main([*words, "--quiet"]) == 0
    assert sorted(path.name for path in (tmp_path / "report").iterdir()) == ["body.md", "body.png"]
    assert (tmp_path / "report" / "body.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "found.json").read_text())
    assert list(found["summary"]) == ["before", "ours", "networks alone", "no networks", "gradient"]
    assert list(found["scenes"]) == ["beam: walk"]
    assert found["summary"]["ours"]["reduced_percent"] > 80 > found["summary"]["before"]["reduced_percent"] == 0
    table = (tmp_path / "report" / "body.md").read_text()
    assert "| ours |" in table
    assert "| beam: walk |" in table
    assert "ours: " in capsys.readouterr().out
    assert main([*words, "--quiet"]) == 2, "reports are not replaced unasked"


@pytest.mark.parametrize(
    ("words", "message"),
    [([], "CLIP: is missing"), (["absent.bvh"], "absent.bvh: does not exist"), (["walk.bvh", "--model", "nowhere"], "nowhere: is not a model")],
)
def test_the_command_refuses_in_one_line(clip: Motion, tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str], words: list[str], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    write_bvh(tmp_path / "walk.bvh", clip)
    assert main(["evaluate", "--body", *words, "--quiet"]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(said) == 1
    assert message in said[0]


def test_clips_that_leave_no_room_are_refused_in_one_line(clip: Motion, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two frames in which nothing can come and go."""
    write_bvh(tmp_path / "short.bvh", Motion(clip.skeleton, clip.times[:2], clip.root[:2], clip.rotations[:2]))
    assert main(["evaluate", str(tmp_path / "short.bvh"), "--body", "--report", str(tmp_path / "report"), "--quiet"]) == 2
    assert "short.bvh" in capsys.readouterr().err
    assert not list((tmp_path / "report").iterdir())
