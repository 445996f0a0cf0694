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
SIZE = 190  # of a picture
DISTANCE = 0.42  # metres from the hand
VIEWS = {  # from where the left hand is seen, in the world: it lies along X in a T-pose, its palm down
    "sphere": (0.35, -1.0, 0.2),
    "cube": (0.35, -1.0, 0.2),
    "mug": (0.45, 0.15, 1.0),
    "plate edge": (0.2, -1.0, 0.35),
    "two hands": (0.0, -0.5, 1.0),
    "thigh": (1.0, -0.8, 0.15),
}
GRASPED = ("sphere", "mug")
THING, SKIN = (0.25, 0.5, 0.55, 1), (0.80, 0.62, 0.52, 1)
VOXEL = 0.003  # metres, of the skin of the hands


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

    from cbm_addon.hands.avoid import FingerOptions
    from cbm_addon.progress import run
    from cbm_addon.scene.fingers import PoseOptions, pose_fingers
    from cbm_addon.scene.preview import look, pixels_of, render
    from cbm_addon.scene.proxy import plain_material
    from cbm_addon.scene.silence import silence
    from tests.hand_scenes import SCENES, add_things, animate, evaluated_matrices
    from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest

    with silence():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    armature = add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo"), "A"))
    rig = animate(armature, SCENES[name], FRAMES)
    add_skin(armature, rig)
    for thing in add_things(armature, rig, SCENES[name]):
        thing.data.materials.append(plain_material("Thing", THING))
    look(scene)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    frame = FRAMES // 2
    wrist = evaluated_matrices(armature, [rig.mapping.joints["LeftHand"], rig.mapping.fingers["LeftHandMiddle2"]], np.array([frame]))
    middle = np.mean([matrices[0, :3, 3] for matrices in wrist.values()], axis=0)
    aim(scene, middle, np.array(VIEWS[name]))
    pictures = []
    for posed in (False, True):
        if posed:
            run(pose_fingers(bpy.context, armature, PoseOptions(solve=FingerOptions(grasp=name in GRASPED))))
        scene.frame_set(frame)
        scene.render.filepath = str(folder / f"{name}{posed}.png")
        render(scene, write_still=True)
        pictures.append(pixels_of(Path(scene.render.filepath)))
    return np.concatenate(pictures[::-1])


def add_skin(armature, rig) -> None:
    """A mannequin of the rig's own capsules, joined as if they were clay."""
    import bpy

    from cbm_addon.hands.hand import PALM_RADIUS, RADII
    from cbm_addon.rigs.colliders import body_colliders, finger_colliders
    from cbm_addon.rigs.fingers import finger_bones
    from cbm_addon.scene.colliders import surface
    from cbm_addon.scene.proxy import plain_material

    hands = []
    for side in ("Left", "Right"):
        fingers = finger_bones(rig, side)
        parts = finger_colliders(rig, fingers, fingers.length * RADII, fingers.length * PALM_RADIUS)
        hands += zip((*fingers.bones, *[fingers.wrist] * 5), parts, strict=True)
    for pieces in (hands, [(part.bone, part) for part in body_colliders(rig)]):
        mesh = bpy.data.meshes.new("Skin")
        points, faces, owners = [], [], []
        for bone, part in pieces:
            own, _, sides = surface(part)
            faces += [[len(points) + corner for corner in face] for face in sides]
            owners += [(bone, len(points), len(points) + len(own))]
            points += own
        mesh.from_pydata(points, [], faces)
        mesh.materials.append(plain_material("Skin", SKIN))
        mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
        obj = bpy.data.objects.new("Skin", mesh)
        bpy.context.scene.collection.objects.link(obj)
        for bone, first, last in owners:
            group = obj.vertex_groups.get(bone) or obj.vertex_groups.new(name=bone)
            group.add(range(first, last), 1.0, "REPLACE")
        obj.modifiers.new("Armature", "ARMATURE").object = armature
        if pieces is hands:
            remesh = obj.modifiers.new("Remesh", "REMESH")
            remesh.mode, remesh.voxel_size, remesh.use_smooth_shade = "VOXEL", VOXEL, True
            remesh.show_viewport = False  # for pictures alone: it takes long


def aim(scene, middle: np.ndarray, view: np.ndarray) -> None:
    """A camera that sees a hand."""
    import bpy
    from mathutils import Vector

    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.data.lens, camera.data.clip_start = 70, 0.01
    away = Vector(view / np.linalg.norm(view))
    camera.location = Vector(middle) + DISTANCE * away
    camera.rotation_euler = away.to_track_quat("Z", "Y").to_euler()


def save(pixels: np.ndarray, path: Path) -> None:
    import bpy

    height, width, _ = pixels.shape
    image = bpy.data.images.new("Sheet", width, height)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode, settings.compression = "PNG", "RGB", 100
    image.save_render(str(path))


if __name__ == "__main__":
    main()
