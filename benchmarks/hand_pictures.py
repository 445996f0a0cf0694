"""Pictures of finger posing, before and after: `python benchmarks/hand_pictures.py OUT.png` in an environment with bpy."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
FRAMES = 24
SIZE = 260  # of a picture
VIEWS = {  # from where the left hand is seen, in the world: it lies along X in a T-pose, its palm down
    "sphere": (0.55, -1.0, 0.25),
    "cube": (0.55, -1.0, 0.25),
    "mug": (0.9, 0.2, 0.9),
    "plate edge": (0.3, -1.0, 0.25),
    "two hands": (0.3, -0.6, 0.9),
    "thigh": (0.6, -1.0, 0.2),
}
COLOURS = {"Thing": (0.25, 0.5, 0.55, 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("output", type=Path, help="the picture to write")
    parser.add_argument("--only", help="one scene")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as resources:
        os.environ["BLENDER_USER_RESOURCES"] = resources
        sys.path.insert(0, str(REPOSITORY))
        columns = [before_and_after(name, Path(resources)) for name in VIEWS if args.only in (None, name)]
        save(np.concatenate(columns, axis=1), args.output.absolute())


def before_and_after(name: str, folder: Path) -> np.ndarray:
    """Pixels [2 * SIZE, SIZE, 4] from the lowest row: after below before."""
    import bpy

    from cbm_addon.progress import run
    from cbm_addon.scene.fingers import PoseOptions, pose_fingers
    from cbm_addon.scene.preview import look, pixels_of, render
    from cbm_addon.scene.proxy import add_proxy, plain_material
    from cbm_addon.scene.silence import silence
    from tests.hand_scenes import SCENES, add_things, animate, evaluated_matrices
    from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest

    with silence():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    armature = add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo"), "A"))
    add_proxy(armature)
    rig = animate(armature, SCENES[name], FRAMES)
    for thing in add_things(armature, rig, SCENES[name]):
        thing.data.materials.append(plain_material("Thing", COLOURS["Thing"]))
    look(scene)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    frame = FRAMES // 2
    wrist = evaluated_matrices(armature, [rig.mapping.joints["LeftHand"], rig.mapping.fingers["LeftHandMiddle2"]], np.array([frame]))
    middle = np.mean([matrices[0, :3, 3] for matrices in wrist.values()], axis=0)
    aim(scene, middle, np.array(VIEWS[name]))
    pictures = []
    for posed in (False, True):
        if posed:
            run(pose_fingers(bpy.context, armature, PoseOptions()))
        scene.frame_set(frame)
        scene.render.filepath = str(folder / f"{name}{posed}.png")
        render(scene, write_still=True)
        pictures.append(pixels_of(Path(scene.render.filepath)))
    return np.concatenate(pictures[::-1])


def aim(scene, middle: np.ndarray, view: np.ndarray) -> None:
    """A camera that sees a hand."""
    import bpy
    from mathutils import Vector

    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.data.lens, camera.data.clip_start = 70, 0.01
    away = Vector(view / np.linalg.norm(view))
    camera.location = Vector(middle) + 0.62 * away
    camera.rotation_euler = away.to_track_quat("Z", "Y").to_euler()


def save(pixels: np.ndarray, path: Path) -> None:
    import bpy

    height, width, _ = pixels.shape
    image = bpy.data.images.new("Sheet", width, height)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()


if __name__ == "__main__":
    main()
