"""What finger posing works with, drawn over the 3D view: the capsules of hands and body, and the cells around the hands that something fills."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..errors import InputError
from ..hands.hand import Hand
from ..hands.sensor import Grid, reachable_grid
from ..hands.shapes import Capsules
from ..motion.rotations import Array, matrix_from_quat, normalize
from .fingers import FingersAt, PoseOptions

AROUND = 12  # corners of a capsule's rings
COLOURS = {"hands": (0.35, 0.75, 1.0, 0.9), "body": (1.0, 0.75, 0.25, 0.5), "cells": (1.0, 0.25, 0.2, 0.6)}
FULL = 0.05  # how full a cell is at least that is drawn

_CUBE = np.array([[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
_CORNERS = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij"), axis=-1).reshape(-1, 3)
