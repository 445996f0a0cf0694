"""The figure of a proxy: closed pieces for every part of the body, flat on the floor, as large as the rig."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.rigs.recognize import recognized
from cbm_addon.rigs.rig import Bones, Rig
from cbm_addon.scene.figure import DARK, LEFT, PALE, RIGHT, figure


def t_posed_rig(scale: float = 1.0) -> Rig:
    """The standard body with a bone for every joint, all of them pointing up."""
    rest = np.tile(np.eye(4), (len(STANDARD_BODY), 1, 1))
    rest[:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    rest[:, :3, 3] = STANDARD_BODY.rest_positions() + np.array([0, 0, STANDARD_BODY.height_above_toes("Hips")])
    return recognized(
        Bones(
            name="rig",
            bones=STANDARD_BODY.names,
            parents=STANDARD_BODY.parents,
            rest=rest,
            lengths=np.full(len(rest), 0.08),
            inherits_rotation=np.ones(len(rest), bool),
            local_location=np.ones(len(rest), bool),
            constrained=np.zeros(len(rest), bool),
            object_matrix=np.diag([scale, scale, scale, 1.0]),
        )
    )


def test_every_joint_moves_a_piece_and_every_piece_is_thick():
    pieces = figure(t_posed_rig(), list(STANDARD_BODY.names))
    assert {piece.bone for piece in pieces} == set(STANDARD_BODY.names)
    for piece in pieces:
        extent = np.sort(np.linalg.svd(piece.rings.reshape(-1, 3) - piece.rings.mean((0, 1)), compute_uv=False))
        assert extent[0] > 0.01, piece.bone


def test_sides_have_their_colours_and_mirror_each_other():
    pieces = figure(t_posed_rig(), list(STANDARD_BODY.names))
    corners = {material: np.concatenate([piece.rings.reshape(-1, 3) for piece in pieces if piece.material == material]) for material in (LEFT, RIGHT)}
    assert corners[LEFT][:, 0].min() > -0.02
    assert corners[RIGHT][:, 0].max() < 0.02
    assert corners[LEFT][:, 0].max() == pytest.approx(-corners[RIGHT][:, 0].min(), abs=1e-6)
    np.testing.assert_allclose(corners[LEFT][:, 1:].max(0), corners[RIGHT][:, 1:].max(0), atol=1e-6)
    assert {piece.bone for piece in pieces if piece.material == DARK} == {"Head"}
    assert "Spine1" in {piece.bone for piece in pieces if piece.material == PALE}


@pytest.mark.parametrize("scale", [0.1, 1.0, 50.0])
def test_it_stands_on_the_floor_and_is_as_tall_as_the_rig(scale):
    pieces = figure(t_posed_rig(scale), list(STANDARD_BODY.names))
    heights = np.concatenate([piece.rings.reshape(-1, 3)[:, 2] for piece in pieces])
    assert heights.min() == pytest.approx(0, abs=1e-6 * scale)
    assert heights.max() == pytest.approx(1.75 * scale, rel=0.05)


def test_bones_that_do_not_deform_get_nothing():
    assert figure(t_posed_rig(), []) == []
    assert {piece.bone for piece in figure(t_posed_rig(), ["Head", "LeftLeg"])} == {"Head", "LeftLeg"}
