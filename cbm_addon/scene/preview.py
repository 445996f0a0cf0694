"""Previews: Workbench pictures and videos of a bake, rendered in a scene of their own that is removed afterwards."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError
from ..motion.resample import lerp_samples
from ..motion.rotations import Array, yaw_from_quat
from ..progress import Progress
from ..takes.take import HEAD, Take
from .action import Channel, scene_frames, scene_rate, write_action
from .proxy import meshes_of
from .silence import silence
from .stage import add_camera, add_floor, add_markers
from .takes import animate_tracker

VIDEO_FRAMES = 300
VIDEO_RATE = 12.0  # frames per second below which a video no longer shows how something moves
VIDEO_SIZE = (640, 360)
CHUNK = 15  # frames of a video from one event of progress to the next
MOMENTS = 8  # pictures of a sheet
SHEET_COLUMNS, SHEET_SIZE = 4, (400, 400)
BESIDE_COLUMNS, BESIDE_SIZE = 4, (320, 360)  # several actions side by side: how many, and the size of each
ROW_SIZE = (240, 320)  # a picture in a sheet that gives each of several actions a row
CAMERA_SECONDS = 1.0  # the camera follows the head's path under a Gaussian of this standard deviation
CAMERA_RATE = 10.0  # keys per second of the camera
ABOVE_HEAD = 1.13  # height of a body over that of its head joint
ROOM = 0.25  # metres around the body
MARGIN = 3.0  # metres of floor around the path
BACKGROUND = (0.16, 0.17, 0.19)
SUFFIXES = {".mp4": "a video", ".png": "a sheet of pictures"}


@dataclass(frozen=True)
class Shot:
    """What there is to see: an armature with an action, and the calibrated take that it was baked from, scaled about the world origin.

    head_height  standing height of the armature's head joint, world units
    actions      the actions to compare, if there are several; they are shown beside each other, or in a sheet below each other
    """

    armature: bpy.types.Object
    take: Take
    scale: float
    head_height: float
    actions: tuple[bpy.types.Action, ...] = ()

    @contextmanager
    def playing(self, stage: bpy.types.Scene, action: bpy.types.Action | None) -> Iterator[None]:
        """The armature does an action, which is named in the picture; without one it does what it does."""
        if action is None:
            yield
            return
        data = self.armature.animation_data
        before = data.action, getattr(data, "action_slot", None)
        render = stage.render
        render.use_stamp, render.stamp_note_text = True, action.name
        try:
            _assign(data, action, action.slots[0] if hasattr(action, "slots") else None)
            yield
        finally:
            _assign(data, *before)


def _assign(data: bpy.types.AnimData, action: bpy.types.Action | None, slot: bpy.types.ActionSlot | None) -> None:
    data.action = action
    if slot is not None:
        data.action_slot = slot


def check_preview(path: Path) -> None:
    """InputError for a file of a kind that is not rendered here."""
    if path.suffix.lower() not in SUFFIXES:
        kinds = " or ".join(f"{suffix} for {kind}" for suffix, kind in SUFFIXES.items())
        raise InputError(path, f"is no kind of preview that is known; it must end in {kinds}")


def render_preview(scene: bpy.types.Scene, shot: Shot, path: Path) -> Generator[Progress, None, None]:
    """Renders `shot` to `path`: an .mp4 of at most VIDEO_FRAMES frames from its start, or a .png with moments of the whole of it.

    The scene and its settings are left as they are.
    """
    check_preview(path)
    path = path.absolute()  # Blender may have another idea of the working folder
    with _stage(scene, shot) as stage:
        yield from _video(stage, shot, path) if path.suffix.lower() == ".mp4" else _sheet(stage, shot, path)


@contextmanager
def _stage(scene: bpy.types.Scene, shot: Shot) -> Iterator[bpy.types.Scene]:
    """A temporary scene with the armature's meshes, a floor, markers at the trackers and a camera that follows."""
    known = {kind: set(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "cameras", "actions", "worlds", "images")}
    stage = bpy.data.scenes.new("CBM Preview")
    try:
        stage.render.fps, stage.render.fps_base, stage.frame_start = scene.render.fps, scene.render.fps_base, scene.frame_start
        for mesh in meshes_of(shot.armature):
            stage.collection.objects.link(mesh)
        heads = shot.take.positions[:, HEAD] * np.float32(shot.scale)
        add_floor(stage.collection, np.stack((heads.min(0), heads.max(0))), MARGIN)
        for device, marker in add_markers(stage.collection).items():
            animate_tracker(marker, stage, shot.take, device, shot.scale)
        look(stage)
        yield stage
    finally:
        bpy.data.scenes.remove(stage)
        for kind, before in known.items():
            collection = getattr(bpy.data, kind)
            for block in set(collection) - before:
                collection.remove(block)


def look(stage: bpy.types.Scene) -> None:
    stage.world = bpy.data.worlds.new("CBM Preview")
    stage.world.color = BACKGROUND
    stage.view_settings.view_transform = "Standard"
    stage.render.engine = "BLENDER_WORKBENCH"
    stage.render.use_file_extension = False
    for name in (name for name in dir(stage.render) if name.startswith("use_stamp")):
        setattr(stage.render, name, name == "use_stamp_note")
    stage.render.use_stamp = False
    shading = stage.display.shading
    shading.light, shading.color_type = "STUDIO", "MATERIAL"
    shading.show_shadows = shading.show_cavity = True
    shading.shadow_intensity = 0.4


def _follow(stage: bpy.types.Scene, shot: Shot, size: tuple[int, int]) -> None:
    """A camera before the body as it stands at the start, moving along with its smoothed path."""
    stage.render.resolution_x, stage.render.resolution_y = size
    take = shot.take
    facing = float(yaw_from_quat(take.rotations[0, HEAD]))
    camera = add_camera(stage, stage.collection, facing, 0, ABOVE_HEAD * shot.head_height, ROOM * shot.scale)
    times = np.arange(take.times[0], take.times[-1] + 1 / CAMERA_RATE, 1 / CAMERA_RATE)
    path = _smooth(lerp_samples(take.times, take.positions[:, HEAD], times) * np.float32(shot.scale), CAMERA_SECONDS * CAMERA_RATE)
    path[:, 2] = 0
    frames = scene_frames(stage, times, stage.frame_start)
    write_action(camera, "CBM Camera", frames, [Channel("location", path + np.array(camera.location), "Transform")], fake_user=False)


def _smooth(values: Array, deviation: float) -> Array:
    """Values [T, N] under a Gaussian of that many samples; the ends are held."""
    reach = int(3 * deviation)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    padded = np.concatenate((np.repeat(values[:1], reach, 0), values, np.repeat(values[-1:], reach, 0)))
    return np.stack([np.convolve(column, weights / weights.sum(), "valid") for column in padded.T], axis=-1)


def _last_frame(stage: bpy.types.Scene, shot: Shot) -> int:
    return stage.frame_start + int(np.floor(shot.take.seconds * scene_rate(stage) + 1e-6))


def video_frames(first: int, last: int, rate: float) -> tuple[range, float]:
    """The frames of a video and its rate: every n-th frame, as few as movement allows, then as many as VIDEO_FRAMES."""
    wanted = -(-(last - first + 1) // VIDEO_FRAMES)
    step = max(1, min(wanted, int(rate / VIDEO_RATE)))
    frames = range(first, last + 1, step)[:VIDEO_FRAMES]
    return frames, rate / step


def _video(stage: bpy.types.Scene, shot: Shot, path: Path) -> Generator[Progress, None, None]:
    actions = shot.actions or (None,)
    _follow(stage, shot, BESIDE_SIZE if shot.actions else VIDEO_SIZE)
    stage.display.render_aa = "FXAA"
    frames, rate = video_frames(stage.frame_start, _last_frame(stage, shot), scene_rate(stage))
    with tempfile.TemporaryDirectory() as folder:
        stage.frame_step = frames.step
        for i, action in enumerate(actions):
            stage.render.filepath = str(Path(folder, f"{i}-####.png"))
            with shot.playing(stage, action):
                for start in range(0, len(frames), CHUNK):
                    yield Progress((i + start / len(frames)) / len(actions), f"rendering {path.suffix[1:]}")
                    chunk = frames[start : start + CHUNK]
                    stage.frame_start, stage.frame_end = chunk[0], chunk[-1]
                    render(stage, animation=True)
        pictures = [sorted(Path(folder).glob(f"{i}-*.png")) for i in range(len(actions))]
        if shot.actions:
            for beside in zip(*pictures, strict=True):
                _save_picture(_grid([pixels_of(picture) for picture in beside], BESIDE_COLUMNS), beside[0])
            columns = min(BESIDE_COLUMNS, len(actions))
            stage.render.resolution_x *= columns
            stage.render.resolution_y *= -(-len(actions) // columns)
        _encode(stage, pictures[0], rate, path)


def _encode(stage: bpy.types.Scene, pictures: list[Path], rate: float, path: Path) -> None:
    """H.264 from pictures, by Blender's own sequencer."""
    settings = stage.render
    editor = stage.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strip = strips.new_image("pictures", str(pictures[0]), 1, stage.frame_start)
    for picture in pictures[1:]:
        strip.elements.append(picture.name)
    stage.frame_end, stage.frame_step = stage.frame_start + len(pictures) - 1, 1
    settings.fps, settings.fps_base = round(rate), round(rate) / rate
    if hasattr(settings.image_settings, "media_type"):
        settings.image_settings.media_type = "VIDEO"
    settings.image_settings.file_format = "FFMPEG"
    settings.ffmpeg.format, settings.ffmpeg.codec = "MPEG4", "H264"
    settings.ffmpeg.constant_rate_factor = "HIGH"
    settings.filepath = str(path)
    render(stage, animation=True)


def _sheet(stage: bpy.types.Scene, shot: Shot, path: Path) -> Generator[Progress, None, None]:
    actions = shot.actions or (None,)
    _follow(stage, shot, ROW_SIZE if shot.actions else SHEET_SIZE)
    frames = np.linspace(stage.frame_start, _last_frame(stage, shot), MOMENTS).round().astype(int)
    pictures = []
    with tempfile.TemporaryDirectory() as folder:
        for action in actions:
            with shot.playing(stage, action):
                for frame in frames.tolist():
                    yield Progress(len(pictures) / len(frames) / len(actions), f"rendering {path.suffix[1:]}")
                    pictures.append(pixels_of(_picture(stage, frame, Path(folder, f"{len(pictures)}.png"))))
    _save_picture(_grid(pictures, MOMENTS if shot.actions else SHEET_COLUMNS), path)


def _grid(pictures: list[Array], columns: int) -> Array:
    """Pictures [height, width, 4] of one size, from their lowest rows, in rows of so many from the top left, as one."""
    height, width, _ = pictures[0].shape
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    grid = np.zeros((rows * height, columns * width, 4), dtype=np.float32)
    for i, picture in enumerate(pictures):
        bottom, left = (rows - 1 - i // columns) * height, i % columns * width
        grid[bottom : bottom + height, left : left + width] = picture
    return grid


def _save_picture(pixels: Array, path: Path) -> None:
    height, width, _ = pixels.shape
    image = bpy.data.images.new("CBM Preview", width, height)
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def _picture(stage: bpy.types.Scene, frame: int, path: Path) -> Path:
    stage.frame_set(frame)
    stage.render.filepath = str(path)
    render(stage, write_still=True)
    return path


def render(stage: bpy.types.Scene, **how: bool) -> None:
    with silence(), bpy.context.temp_override(scene=stage):  # naming the scene to the operator would not evaluate its animation
        bpy.ops.render.render(**how)


def pixels_of(path: Path) -> Array:
    """Pixels [height, width, 4] of a picture file, from its lowest row."""
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)
