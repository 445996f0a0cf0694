"""Frames of reference of recordings: the matrices to engine axes.

A world matrix C takes points by p' = C p. A device matrix D does the same for the device's own frame, so that rotations become
R' = C R Dᵀ. In most formats the two are one matrix; where Blender holds the poses of devices, the world has Z up and the devices keep
the frames that they were recorded in. Working with matrices handles left-handed sources (det C = det D = -1) without a sign recipe per
quaternion.
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array, matrix_from_quat, quat_from_matrix

_LOOKS_ALONG_MINUS_Z = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])  # X right, Y up
_LOOKS_ALONG_PLUS_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # X left, Y up
_LOOKS_ALONG_PLUS_Y = np.diag([-1.0, -1, 1])  # X right, Z up

AXES = {
    "engine": np.eye(3),
    # right-handed, X right, Y up, looking along -Z: OpenXR, OpenVR, WebXR, glTF
    "openxr": _LOOKS_ALONG_MINUS_Z,
    # left-handed, X right, Y up, looking along +Z: Unity, .bsor
    "unity": np.array([[-1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    # left-handed, X forward, Y right, Z up: Unreal
    "unreal": np.array([[0, -1.0, 0], [-1, 0, 0], [0, 0, 1]]),
    # right-handed, Z up, looking along +Y: glTF in Blender, and much else with Z up
    "zup": np.eye(3),
    # Z up, while devices look along their own -Z with Y up: Blender's cameras and the poses of its VR session
    "blender": np.eye(3),
    # Z up, while devices look along their own +Z with Y up: FBX from programs with Y up, in Blender
    "fbx": np.eye(3),
}
"""World matrices by name. Which way somebody looks in a world with Z up does not matter: there the world stays as it is."""

_OWN_DEVICE_AXES = {"zup": _LOOKS_ALONG_PLUS_Y, "blender": _LOOKS_ALONG_MINUS_Z, "fbx": _LOOKS_ALONG_PLUS_Z}

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def device_axes(axes: str) -> Array:
    """The matrix from a device's own frame to engine axes, float64 [3, 3]."""
    return _OWN_DEVICE_AXES.get(axes, AXES[axes])


def to_engine(positions: Array, rotations: Array, axes: str) -> tuple[Array, Array]:
    """Positions [..., 3] and rotations [..., 4] from axes named in AXES to engine axes; NaN stays NaN."""
    c = AXES[axes]
    return positions @ c.T, quat_from_matrix(c @ matrix_from_quat(rotations) @ device_axes(axes).T)
