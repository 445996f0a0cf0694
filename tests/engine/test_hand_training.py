"""Training of the hands: poses from files, geometry that leaves them free, and a model folder that the solver takes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

from cbm_addon.cli import main  # noqa: E402
from cbm_addon.errors import InputError  # noqa: E402
from cbm_addon.hands.contact import SOLVING, axis_points, point_radii  # noqa: E402
from cbm_addon.hands.hand import LIMITS, Hand, _directions, finger_angles  # noqa: E402
from cbm_addon.hands.model import load_hand_model, read_card  # noqa: E402
from cbm_addon.hands.poses import POSES  # noqa: E402
from cbm_addon.hands.sensor import Grid, reachable_grid, wanted_places  # noqa: E402
from cbm_addon.hands.standard import standard_hand  # noqa: E402
from cbm_addon.learn.config import read_settings  # noqa: E402
from cbm_addon.learn.hands.config import HandConfig  # noqa: E402
from cbm_addon.learn.hands.free_poses import _handyjs, held_out, read_free_poses  # noqa: E402
from cbm_addon.learn.hands.geometry import noise_samples, random_solids, shape_samples  # noqa: E402
from cbm_addon.learn.hands.pose_bank import HandBank, interpolated, make_bank, without_self_collision  # noqa: E402
from cbm_addon.learn.hands.training import train_hands  # noqa: E402
from cbm_addon.progress import run  # noqa: E402
from cbm_addon.solve.models import read_card as read_body_card  # noqa: E402

CONFIGS = Path(__file__).resolve().parents[2] / "cbm_addon" / "learn" / "hands" / "configs"
WEBXR = [1, 2, 3, 6, 7, 8, 11, 12, 13, 16, 17, 18, 21, 22, 23, 4, 9, 14, 19, 24]


@pytest.fixture(scope="module")
def poses_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Our own poses, as handy.js would have recorded them: millimetres, 25 joints of WebXR."""
    folder = tmp_path_factory.mktemp("poses")
    recorded = []
    for side in ("left", "right"):
        hand = standard_hand(side)  # type: ignore[arg-type]
        for name, pose in POSES.items():
            joints = np.zeros((25, 3))
            joints[WEBXR] = hand.positions(pose[None])[0] * 1000
            recorded.append({"names": [name], "handedness": side, "jointPositions": joints.tolist()})
    (folder / "handyjs_poses.json").write_text(json.dumps({"poses": recorded}))
    return folder


@pytest.fixture(scope="module")
def grid() -> Grid:
    return reachable_grid()


@pytest.fixture(scope="module")
def bank(grid: Grid) -> HandBank:
    return make_bank(np.stack(list(POSES.values())), grid, 200, 1, seed=0)[0]


def test_recorded_poses_come_back_as_angles(poses_folder: Path) -> None:
    poses = read_free_poses(poses_folder)
    assert len(poses) == 2 * len(POSES)
    found = dict(zip(poses.names, poses.angles, strict=True))
    for name in ("relaxed", "fist", "spread"):
        error = np.degrees(np.abs(finger_angles(found[name]) - finger_angles(POSES[name])))
        assert error[1:, :3].max() < 6, name


def test_both_hands_of_a_name_are_held_out_together(poses_folder: Path) -> None:
    trained, kept = held_out(read_free_poses(poses_folder))
    assert not set(trained.names) & set(kept.names)
    assert len(kept) > 0
    assert all(kept.names.count(name) == 2 for name in kept.names)


def test_a_folder_without_poses_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no hand poses"):
        read_free_poses(tmp_path)


def test_interpolated_poses_stay_within_the_limits() -> None:
    angles = interpolated(np.stack(list(POSES.values())), 500, np.random.default_rng(0))
    assert ((angles >= LIMITS[:, 0]) & (angles <= LIMITS[:, 1])).all()


def test_fingers_that_cross_collide() -> None:
    hand, crossed = standard_hand(), POSES["flat"].copy()
    crossed[[7, 11]] = np.radians((-20, 20))  # the index toward the middle finger and the other way round
    flat, collided = without_self_collision(hand, np.stack((POSES["spread"], crossed)))
    assert flat
    assert not collided


def test_noise_leaves_the_hand_free_and_pulls_joints_to_what_is_full(bank: HandBank, grid: Grid) -> None:
    samples = noise_samples(bank, grid, 64, np.random.default_rng(1))
    points = bank.hand.positions(samples.angles) @ bank.hand.palm / bank.hand.length
    centres = grid.centres()
    for sample in range(8):
        for joint in (2, 5, 16):
            closest = np.linalg.norm(centres - points[sample, joint], axis=-1).argmin()
            assert samples.occupancy[sample, closest] == 0, "the cell of a joint is empty (eq. 9)"
    assert 0.3 < samples.occupancy[samples.occupancy > 0].mean() < 0.7
    pulled = np.linalg.norm(samples.places.reshape(64, 20, 3) - points, axis=-1)
    assert pulled.max() < 0.2, "the nearest full cell is just outside of the hand (eq. 10)"
    assert pulled.mean() > 0.01


@pytest.mark.parametrize("other_hand", [False, True], ids=["solids", "the other hand"])
def test_shapes_touch_the_pose_and_do_not_enter_it(bank: HandBank, grid: Grid, other_hand: bool) -> None:
    samples = shape_samples(bank, grid, 128, np.random.default_rng(2), other_hand)
    chains = bank.hand.chains(finger_angles(samples.angles))
    points = axis_points(bank.hand, chains, SOLVING) @ bank.hand.palm / bank.hand.length
    radii = point_radii(bank.hand, SOLVING)[..., None] / bank.hand.length
    full = samples.occupancy == 1
    assert 0.01 < full.mean() < 0.5
    for sample in range(0, 128, 8):
        inside = grid.centres()[full[sample]]
        if len(inside):
            nearest = np.linalg.norm(points[sample][..., None, :] - inside, axis=-1)
            assert (nearest - radii).min() > -1e-3, "cells inside of a shape are outside of the fingers"


def test_the_wanted_pose_differs_where_a_finger_was_bent_into_a_shape(bank: HandBank, grid: Grid) -> None:
    samples = shape_samples(bank, grid, 128, np.random.default_rng(3))
    moved = np.linalg.norm((samples.places - wanted_places(bank.hand, bank.hand.positions(samples.angles))).reshape(128, 20, 3), axis=-1)
    assert (moved.max(-1) > 0.03).mean() > 0.3
    assert (moved[:, 16:].min(-1) < 0.02).mean() > 0.3, "other fingers are left where they are"


def test_solids_pass_through_their_points_and_face_as_asked() -> None:
    random = np.random.default_rng(4)
    near, normals = random.normal(size=(200, 3)) * 0.3, random.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    solids = random_solids(near, normals, random)
    np.testing.assert_allclose(solids.distances(near[:, None].astype(np.float32))[:, 0], 0, atol=1e-4)
    outside = solids.distances((near + 0.01 * normals)[:, None].astype(np.float32))[:, 0]
    np.testing.assert_allclose(outside, 0.01, atol=1e-4)


def test_a_training_run_makes_a_model_that_proposes(poses_folder: Path, tmp_path: Path) -> None:
    config = HandConfig(name="small", poses=200, hands=1, samples=512, channels=4, classes=4, hidden=16, blocks=1, epochs=1)
    folder = tmp_path / "model"
    run(train_hands(poses_folder, folder, config, resume=False, overwrite=False))
    model = load_hand_model(folder, threads=1)
    angles = model.propose(np.zeros((3, model.grid.count), np.float32), np.zeros((3, 60), np.float32), 2, seed=0)
    assert angles.shape == (2, 3, 20)
    with pytest.raises(InputError, match="holds a model"):
        run(train_hands(poses_folder, folder, config, resume=False, overwrite=False))
    card = (folder / "card.json").read_bytes()
    run(train_hands(poses_folder, folder, config, resume=True, overwrite=True))
    assert (folder / "card.json").read_bytes() == card, "resumed at its end it makes the same model"


def test_a_card_of_the_body_is_not_one_of_the_hands() -> None:
    models = CONFIGS.parents[2] / "models"
    with pytest.raises(InputError, match="another format"):
        read_card(models / "base")
    with pytest.raises(InputError, match="another format"):
        read_body_card(models / "hands")


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_configurations_that_ship_can_be_read(path: Path) -> None:
    assert read_settings(path, HandConfig()).name


def test_the_command_refuses_what_it_cannot_train_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "--hands", str(tmp_path), "-o", str(tmp_path / "model"), "--quiet"]) == 2
    assert "holds no hand poses" in capsys.readouterr().err
    assert main(["train", "--hands", str(tmp_path), str(tmp_path), "-o", str(tmp_path / "model"), "--quiet"]) == 2
    assert "second folder" in capsys.readouterr().err


@pytest.mark.needs_data
def test_recorded_hands_fit_the_axes(data_folder: Path) -> None:
    """The claim of docs/hands.md: within the limits the phalanges of the free poses point where they were recorded to but for a few degrees."""
    errors = []
    for _, side, positions, rest in _handyjs(data_folder / "mocap" / "hands")[::5]:
        hand = Hand.from_rest(side, rest)
        recorded, found = (_directions(values) for values in (positions, hand.positions(hand.angles_from_positions(positions[None]))[0]))
        errors.append(np.degrees(np.arccos(np.clip((recorded * found).sum(-1), -1, 1))))
    assert np.mean(errors) < 4
