"""Files that Blender itself reads: told here by their first bytes, read as takes by `scene/take_files.py`."""

from __future__ import annotations

import re

FBX, GLTF, BLEND = "FBX", "glTF", "a Blender file"
SIGNS = {
    FBX: (b"Kaydara FBX Binary", b"; FBX"),
    GLTF: (b"glTF",),
    BLEND: (b"BLENDER", b"\x28\xb5\x2f\xfd", b"\x1f\x8b"),  # plain, compressed by Blender 3.0 and later, and before
}
GLTF_ASSET = re.compile(rb'^\s*\{.*"asset"\s*:', re.DOTALL)


def format_of(head: bytes) -> str | None:
    """What a file with these first bytes is; None if it is nothing that Blender reads."""
    for name, signs in SIGNS.items():
        if head.startswith(signs):
            return name
    return GLTF if GLTF_ASSET.search(head) else None
