"""Previews show the bake and leave the file as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.resample import frame_times
from cbm_addon.motion.transfer import transfer
from cbm_addon.progress import run
from cbm_addon.rigs.body import rig_body
from cbm_addon.scene.action import scene_frames, write_action
from cbm_addon.scene.bake import rig_channels
from cbm_addon.scene.preview import BESIDE_SIZE, MOMENTS, ROW_SIZE, VIDEO_FRAMES, VIDEO_RATE, Shot, check_preview, render_preview, video_frames
from cbm_addon.scene.proxy import add_proxy, meshes_of
from cbm_addon.scene.rig import read_rig
from cbm_addon.scene.rigify import rigify_human, rigify_metarig
from cbm_addon.solve.perform import sampled
from cbm_addon.takes.calibrate import calibrate
from cbm_addon.takes.sample_motion import sample_motion, sample_take


@pytest.fixture
def shot(empty_scene: bpy.types.Scene) -> Shot:
    """Half a second of the sample motion on a metarig with a proxy, and its take."""
    armature = rigify_metarig(bpy.context)
    add_proxy(armature)
    rig = read_rig(armature)
    solved = rig_body(rig)
    motion = transfer(sample_motion(), solved.body)
    channels = list(rig_channels(armature, rig, solved, motion))
    write_action(armature, "walk", scene_frames(empty_scene, motion.times, empty_scene.frame_start), channels)
    take = calibrate(sampled(sample_take(), frame_times(0, 0.5, 72))).take
    return Shot(armature, take, 1.0, solved.body.height_above_toes())


def everything() -> dict[str, set[str]]:
    kinds = ("objects", "meshes", "materials", "cameras", "actions", "worlds", "images", "scenes", "collections", "texts")
    return {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds}


def pixels(path: Path) -> np.ndarray:
    image = bpy.data.images.load(str(path))
    values = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(values)
    width, height = image.size
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)


def test_a_picture_shows_a_body_with_two_sides_on_a_floor(shot, tmp_path):
    run(render_preview(bpy.context.scene, shot, tmp_path / "sheet.png"))
    first = pixels(tmp_path / "sheet.png")[-400:, :400, :3]
    red, _, blue = np.moveaxis(first, -1, 0)
    left, right = (blue > red + 0.15).mean(), (red > blue + 0.15).mean()
    assert 0.005 < left < 0.2, "the body's left is blue"
    assert 0.005 < right < 0.2, "the body's right is orange"
    assert first.std(axis=(0, 1)).max() > 0.05
    assert (blue > red + 0.15)[:, 60:-60].sum() == (blue > red + 0.15).sum(), "the body is in the middle of the picture"


def test_variations_are_shown_below_each_other_and_the_first_stays(shot, tmp_path):
    walk = shot.armature.animation_data.action
    still = write_action(shot.armature, "still", np.array([1.0]), [])
    write_action(shot.armature, "again", np.array([1.0]), [])
    compared = replace(shot, actions=(walk, still))
    run(render_preview(bpy.context.scene, compared, tmp_path / "sheet.png"))
    sheet = pixels(tmp_path / "sheet.png")
    assert sheet.shape == (2 * ROW_SIZE[1], MOMENTS * ROW_SIZE[0], 4)
    lower, upper = sheet[: ROW_SIZE[1], : ROW_SIZE[0]], sheet[ROW_SIZE[1] :, : ROW_SIZE[0]]
    body = slice(None, -20)  # below the name that is written into each
    assert np.abs(lower[body] - upper[body]).max() > 0.2
    assert shot.armature.animation_data.action.name == "again"


def test_a_video_has_every_frame_of_a_short_take(shot, tmp_path):
    scene = bpy.context.scene
    run(render_preview(scene, shot, tmp_path / "walk.mp4"))
    editor = bpy.data.scenes.new("Viewer").sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    movie = strips.new_movie("walk", str(tmp_path / "walk.mp4"), 1, 1)
    assert movie.frame_duration == 13
    assert movie.fps == pytest.approx(scene.render.fps)


def test_a_video_of_variations_has_them_side_by_side(shot, tmp_path):
    walk = shot.armature.animation_data.action
    run(render_preview(bpy.context.scene, replace(shot, actions=(walk, write_action(shot.armature, "still", np.array([1.0]), []))), tmp_path / "both.mp4"))
    movie = bpy.data.movieclips.load(str(tmp_path / "both.mp4"))
    assert tuple(movie.size) == (2 * BESIDE_SIZE[0], BESIDE_SIZE[1])
    assert movie.frame_duration == 13


@pytest.mark.parametrize("name", ["preview.png", "preview.mp4"])
def test_the_file_is_left_as_it_was(shot, tmp_path, name):
    scene = bpy.context.scene
    scene.frame_set(5)
    scene.render.filepath, scene.render.resolution_x = "//mine", 123
    before, window = everything(), bpy.context.window.scene
    run(render_preview(scene, shot, tmp_path / name))
    assert everything() == before
    assert bpy.context.window.scene == window == scene
    assert (scene.frame_current, scene.render.filepath, scene.render.resolution_x, scene.camera) == (5, "//mine", 123, None)
    assert shot.armature.animation_data.action.name == "walk"


def test_a_preview_that_is_stopped_leaves_nothing(shot, tmp_path):
    before = everything()
    job = render_preview(bpy.context.scene, shot, tmp_path / "preview.mp4")
    next(job)
    job.close()
    assert everything() == before
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("seconds", [1, 20, 36, 600])
@pytest.mark.parametrize("rate", [24.0, 29.97, 60.0, 120.0])
def test_videos_are_short_smooth_and_in_real_time(seconds, rate):
    frames, video_rate = video_frames(1, int(seconds * rate), rate)
    assert len(frames) <= VIDEO_FRAMES
    assert video_rate >= VIDEO_RATE
    assert frames.step / rate == pytest.approx(1 / video_rate)
    assert frames[-1] == pytest.approx(seconds * rate, abs=frames.step) or len(frames) == VIDEO_FRAMES


def test_other_kinds_of_file_are_refused():
    with pytest.raises(InputError, match=r"preview\.gif: .*\.mp4"):
        check_preview(Path("preview.gif"))


@pytest.mark.parametrize(("preset", "top_bone"), [(rigify_human, "root"), (rigify_metarig, "spine")], ids=["generated", "metarig"])
def test_a_proxy_has_the_size_of_its_rig_and_follows_it(empty_scene, preset, top_bone):
    armature = preset(bpy.context)
    armature.location, armature.scale = (1, 2, 0), (1.5, 1.5, 1.5)
    assert not meshes_of(armature)
    proxy = add_proxy(armature)
    assert meshes_of(armature) == [proxy]
    rig = read_rig(armature)

    def corners() -> np.ndarray:
        posed = proxy.evaluated_get(bpy.context.evaluated_depsgraph_get())
        return np.array([posed.matrix_world @ vertex.co for vertex in posed.data.vertices])

    rest = corners()
    assert rest[:, 2].min() == pytest.approx(0, abs=0.01)
    assert rest[:, 2].max() == pytest.approx(rig.head(rig.mapping.joints["Head"])[2] * 1.13, rel=0.05)
    assert rest[:, 0].max() - 1 == pytest.approx(1 - rest[:, 0].min(), abs=0.01), "the two sides mirror each other"
    armature.pose.bones[top_bone].location = (0.3, 0, 0)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(np.linalg.norm(corners() - rest, axis=-1), 0.3 * 1.5, atol=1e-4)
