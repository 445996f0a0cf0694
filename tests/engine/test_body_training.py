"""Training of body avoidance: poses from clips, geometry that leaves them free, and a model folder that the solver takes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

from cbm_addon.body.freedom import Freedom  # noqa: E402
from cbm_addon.body.model import ANSWERS, TURNING, load_body_model  # noqa: E402
from cbm_addon.body.sensor import PLACES, roots  # noqa: E402
from cbm_addon.body.shape import body_shape  # noqa: E402
from cbm_addon.cli import main  # noqa: E402
from cbm_addon.errors import InputError  # noqa: E402
from cbm_addon.features import RATE  # noqa: E402
from cbm_addon.hands.obstacle import over_time  # noqa: E402
from cbm_addon.hands.sensor import Grid  # noqa: E402
from cbm_addon.hands.shapes import Sphere  # noqa: E402
from cbm_addon.learn.avoidance import fit  # noqa: E402
from cbm_addon.learn.body.config import BodyConfig  # noqa: E402
from cbm_addon.learn.body.geometry import AWAY, noise_samples, shape_samples  # noqa: E402
from cbm_addon.learn.body.pose_bank import STEP, PoseBank, read_poses  # noqa: E402
from cbm_addon.learn.body.training import CHECKPOINT, make_pool, train_body  # noqa: E402
from cbm_addon.learn.config import read_settings  # noqa: E402
from cbm_addon.motion.bvh import write_bvh  # noqa: E402
from cbm_addon.motion.motion import Motion  # noqa: E402
from cbm_addon.motion.resample import frame_times, resample  # noqa: E402
from cbm_addon.motion.rotations import matrix_from_quat, matrix_from_sixd, multiply, quat_from_yaw  # noqa: E402
from cbm_addon.progress import run  # noqa: E402
from cbm_addon.takes.sample_motion import sample_motion  # noqa: E402

CONFIGS = Path(__file__).resolve().parents[2] / "cbm_addon" / "learn" / "body" / "configs"
SMALL = BodyConfig(name="small", poses=100, samples=256, channels=4, classes=4, hidden=16, blocks=1, epochs=2, batch=64)
SAMPLES = 128


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory, body_motion: Motion) -> Path:
    """The procedural walk, as our own BVH."""
    folder = tmp_path_factory.mktemp("clips")
    write_bvh(folder / "walk.bvh", body_motion)
    return folder


@pytest.fixture(scope="module")
def bank(clips: Path) -> PoseBank:
    return run(read_poses([clips / "walk.bvh"], 1000, seed=0))


@pytest.fixture(scope="module")
def grid(bank: PoseBank) -> Grid:
    return bank.grid(SMALL.cell)


@pytest.fixture(scope="module")
def distances(bank: PoseBank, grid: Grid) -> np.ndarray:
    return bank.cell_distances(grid)


def mirrored(places: np.ndarray) -> np.ndarray:
    """Places [N, P, 3] of a body seen in a mirror that stands between its sides."""
    swapped = [PLACES.index(name.replace("Left", "?").replace("Right", "Left").replace("?", "Right")) for name in PLACES]
    return places[:, swapped] * [-1, 1, 1]


# Poses


def test_poses_are_seen_from_the_root(bank: PoseBank) -> None:
    """Wherever the walk went and faced: the head above the hips, feet below, the left hand to the left, all in heights of the head joint."""
    at = dict(zip(PLACES, np.moveaxis(bank.places, 1, 0), strict=True))
    assert (at["LeftArm"][:, 0] > at["RightArm"][:, 0]).all()
    assert (np.abs(at["Head"][:, :2]) < 0.3).all()
    assert (at["Head"][:, 2] > 0.2).all()
    assert np.median(at["Head"][:, 2] - bank.feet[:, 2]) == pytest.approx(0.9, abs=0.05)  # ankles are above the floor, and knees bent
    np.testing.assert_allclose((at["LeftFoot"] + at["RightFoot"]) / 2, bank.feet, atol=1e-6)


def test_poses_are_those_that_the_networks_will_see(bank: PoseBank, body_motion: Motion) -> None:
    """Each is that of a frame of the clip, or of its mirror image, as the sensor and the answers of the solver measure it."""
    freedom, unit = Freedom(body_motion), body_shape(body_motion.skeleton).unit
    every = np.arange(len(body_motion))
    positions, turns = roots(freedom, every)
    seen = (freedom.positions[:, body_motion.skeleton.indices(PLACES)] - positions[:, None]) @ turns / unit
    both = np.concatenate((seen, mirrored(seen)))
    apart = np.abs(bank.places[:, None] - both[None]).max((-1, -2))
    assert apart.min(-1).max() < 2e-3
    assert set(apart.argmin(-1) < len(seen)) == {True, False}, "half of them are mirror images"
    recorded = np.flatnonzero(apart.argmin(-1) < len(seen))
    frames = apart.argmin(-1)[recorded]
    expected = np.swapaxes(turns[frames], -1, -2)[:, None] @ freedom.world[frames][:, body_motion.skeleton.indices(TURNING)]
    np.testing.assert_allclose(matrix_from_sixd(bank.rotations[recorded]), expected, atol=1e-2)


def test_a_body_that_is_turned_and_carried_elsewhere_gives_the_same_poses(bank: PoseBank, body_motion: Motion, tmp_path: Path) -> None:
    turn, rotations = quat_from_yaw(np.array(1.0)), body_motion.rotations.copy()
    rotations[:, 0] = multiply(turn, rotations[:, 0])
    root = (body_motion.root @ matrix_from_quat(turn).T + [5, -3, 0]).astype(np.float32)
    write_bvh(tmp_path / "walk.bvh", Motion(body_motion.skeleton, body_motion.times, root, rotations))
    again = run(read_poses([tmp_path / "walk.bvh"], 1000, seed=0))
    assert len(again) == len(bank)
    nearest = np.abs(bank.axes[:, None, ::8] - again.axes[None, :, ::8]).max((-1, -2)).min(-1)
    assert nearest.max() < 2e-3


def test_cells_know_how_far_they_are_from_each_body(bank: PoseBank, grid: Grid, distances: np.ndarray) -> None:
    centres, random = grid.centres(), np.random.default_rng(0)
    for pose in random.integers(len(bank), size=5):
        for cell in random.integers(grid.count, size=20):
            expected = np.clip((np.linalg.norm(bank.axes[pose] - centres[cell], axis=-1) - bank.radii).min() / STEP, 0, 255)
            assert distances[pose, cell] == pytest.approx(expected, abs=0.51)


def test_rare_heights_are_drawn_more_often_than_they_are(tmp_path: Path) -> None:
    """On the way down into a crouch and up again the head is rarely as high."""
    write_bvh(tmp_path / "walk.bvh", resample(sample_motion(), frame_times(1.5, 18, RATE)))

    def between(poses: PoseBank) -> float:
        height = poses.places[:, PLACES.index("Head"), 2] - poses.feet[:, 2]
        return float(((height > 0.65) & (height < 0.85)).mean())

    every, some = (run(read_poses([tmp_path / "walk.bvh"], count, seed=0)) for count in (100_000, 60))
    assert len(some) == 60
    assert between(some) > 1.5 * between(every) > 0


def test_clips_without_poses_are_refused(tmp_path: Path, body_motion: Motion) -> None:
    with pytest.raises(InputError, match="holds no poses to train on"):
        run(read_poses([], 10, seed=0))
    root = body_motion.root - np.array([0, 0, 2], np.float32)
    write_bvh(tmp_path / "sunken.bvh", Motion(body_motion.skeleton, body_motion.times, root, body_motion.rotations))
    with pytest.raises(InputError, match=r"sunken\.bvh: holds no poses to train on"):
        run(read_poses([tmp_path / "sunken.bvh"], 10, seed=0))


# Geometry


def pose_of(bank: PoseBank, answers: np.ndarray) -> np.ndarray:
    """Which pose of the bank each answer is."""
    turns = bank.rotations.reshape(len(bank), -1)
    return np.array([np.abs(turns - answer[3:]).max(-1).argmin() for answer in answers])


def test_noise_leaves_the_cells_of_the_body_empty(bank: PoseBank, grid: Grid, distances: np.ndarray) -> None:
    """Eq. 9."""
    samples = noise_samples(bank, distances, grid, SAMPLES, np.random.default_rng(1))
    np.testing.assert_array_equal(samples.answers[:, :3], 0)
    for occupancy, pose in zip(samples.occupancy, pose_of(bank, samples.answers), strict=True):
        beyond = np.linalg.norm(bank.axes[pose][:, None] - grid.centres(), axis=-1) - bank.radii[:, None]
        filled = occupancy > 0
        assert beyond[:, filled].min() > grid.cell - STEP, "no cell that the body is in, or beside, is filled"
        assert filled[beyond.min(0) > grid.cell + STEP].mean() > 0.99
    assert samples.occupancy[samples.occupancy > 0].mean() == pytest.approx(0.5, abs=0.02)


def test_noise_wants_joints_between_where_they_are_and_the_nearest_filled_cell(bank: PoseBank, grid: Grid, distances: np.ndarray) -> None:
    """Eq. 10."""
    samples = noise_samples(bank, distances, grid, SAMPLES, np.random.default_rng(1))
    centres, moved = grid.centres(), []
    for occupancy, wanted, pose in zip(samples.occupancy, samples.places.reshape(SAMPLES, -1, 3), pose_of(bank, samples.answers), strict=True):
        filled = centres[occupancy > 0]
        for place, target in zip(bank.places[pose], wanted, strict=True):
            nearest = np.linalg.norm(filled - place, axis=-1).min()
            assert np.linalg.norm(target - place) <= nearest + 1e-4
            if nearest > 1e-3:
                ends = filled[np.linalg.norm(filled - place, axis=-1) < nearest + 1e-4]
                share = np.linalg.norm(target - place) / nearest
                assert np.abs(place + share * (ends - place) - target).max(-1).min() < 1e-3, "on the line between the two"
                moved.append(share)
    assert np.mean(moved) == pytest.approx(0.5, abs=0.05)


def test_shapes_touch_the_pose_and_are_not_deep_in_it(bank: PoseBank, grid: Grid) -> None:
    samples = shape_samples(bank, grid, SAMPLES, np.random.default_rng(2))
    assert samples.answers.shape == (SAMPLES, ANSWERS)
    assert ((samples.occupancy >= 0) & (samples.occupancy <= 1)).all()
    full, touching = samples.occupancy == 1, 0
    assert 0.01 < full.mean() < 0.5
    for occupancy, answer, pose in zip(samples.occupancy, samples.answers, pose_of(bank, samples.answers), strict=True):
        free = bank.axes[pose] + answer[:3]  # as the wanted root sees it
        beyond = (np.linalg.norm(free[:, None] - grid.centres(), axis=-1) - bank.radii[:, None]).min(0)
        assert beyond[occupancy == 1].min(initial=1) > -1e-3, "cells inside of a shape are outside of the body"
        assert occupancy[beyond < -grid.cell].max(initial=0) < 1e-3, "what is a cell deep in the body is a cell away from any shape"
        touching += bool((beyond[occupancy > 0] < 1.5 * grid.cell).any())
    assert touching > 0.5 * SAMPLES


def test_the_wanted_pose_stands_where_the_free_one_does_and_is_in_the_way(bank: PoseBank, grid: Grid) -> None:
    samples = shape_samples(bank, grid, SAMPLES, np.random.default_rng(3))
    free, places = pose_of(bank, samples.answers), samples.places.reshape(SAMPLES, -1, 3)
    feet = places[:, [PLACES.index("LeftFoot"), PLACES.index("RightFoot")]].mean(1)
    np.testing.assert_allclose(bank.feet[free] + samples.answers[:, :3], feet, atol=1e-3)
    apart = np.linalg.norm(bank.places[free] + samples.answers[:, None, :3] - places, axis=-1)
    assert (apart.max(-1) > AWAY).mean() > 0.5
    entered = 0
    for sample in range(SAMPLES):
        wanted = np.abs(bank.places - places[sample]).max((-1, -2)).argmin()
        cells = np.abs(bank.axes[wanted][:, None] - grid.centres()).max(-1) < grid.cell / 2
        entered += bool((samples.occupancy[sample][cells.any(0)] > 0.5).any())
    assert entered > 0.3 * SAMPLES, "or there would be nothing to learn"


# Training


@pytest.fixture(scope="module")
def trained(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that the command wrote."""
    folder = tmp_path_factory.mktemp("trained")
    (folder / "small.toml").write_text(
        "\n".join(f"{key} = {value!r}".replace("'", '"') for key, value in SMALL.as_dict().items() if value != getattr(BodyConfig(), key)), encoding="utf-8"
    )
    assert main(["train", "--body", str(clips), "-o", str(folder / "model"), "--config", str(folder / "small.toml"), "--quiet"]) == 0
    return folder / "model"


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_training_run_makes_a_model_that_proposes(trained: Path, body_motion: Motion) -> None:
    model = load_body_model(trained, threads=1)
    assert model.card["training"]["configuration"]["hidden"] == SMALL.hidden
    assert model.card["training"]["clips"] == {"train": 1, "validation": 0}
    assert len(model.card["training"]["history"]) == SMALL.epochs
    ball = Sphere(np.zeros(3), 0.5)
    freedom = Freedom(body_motion)
    proposed = model.propose(freedom, 1.6, over_time(lambda frame: ball), np.array([0, 10]), 3, seed=0)
    assert np.array(proposed).shape == (3, 2, len(freedom))
    assert np.isfinite(proposed).all()


def test_the_networks_learn(bank: PoseBank, grid: Grid, tmp_path: Path) -> None:
    config = replace(SMALL, epochs=8, hidden=32)
    pool, held_out = (run(make_pool(bank, grid, config, groups, seed)) for groups, seed in ((8, 1), (1, 2)))
    history = run(fit(pool, held_out, config, tmp_path / "checkpoint.npz", resume=False))[1]
    assert history[-1]["reconstruction"] < 0.8 * history[0]["reconstruction"]
    assert history[-1]["sample"] < history[0]["sample"]
    assert all(said["best_of_8"] <= said["sample"] for said in history)


def test_the_command_lists_it(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", str(trained)]) == 0
    assert "'small'" in capsys.readouterr().out


def test_a_run_that_was_broken_off_goes_on_to_the_same_bytes(clips: Path, trained: Path, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    job = train_body([clips], folder, SMALL, resume=False, overwrite=False)
    next(event for event in job if "epoch 1:" in event.message)
    job.close()
    assert not (folder / "card.json").exists()
    with pytest.raises(InputError, match="holds a checkpoint"):
        run(train_body([clips], folder, SMALL, resume=False, overwrite=False))
    run(train_body([clips], folder, SMALL, resume=True, overwrite=False))
    assert files(folder) == files(trained)
    assert (folder / CHECKPOINT).read_bytes() == (trained / CHECKPOINT).read_bytes()


def test_what_is_there_is_not_replaced_unasked(clips: Path, trained: Path) -> None:
    before = files(trained)
    for resume in (False, True):
        with pytest.raises(InputError, match="holds a model"):
            run(train_body([clips], trained, SMALL, resume=resume, overwrite=False))
    assert files(trained) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["absent"], "absent: does not exist"),
        (["empty"], "empty: holds no BVH files"),
        (["clips", "--from", "base"], "--from: goes on from a model of the body"),
        (["clips", "--config", "wrong.toml"], "wrong.toml"),
        (["clips", "--config", "few.toml"], "samples: is 100; at least 256"),
        (["clips", "--hands"], "not allowed with argument"),
    ],
)
def test_the_command_refuses_in_one_line(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch, words: list[str], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "clips").symlink_to(clips)
    (tmp_path / "wrong.toml").write_text("poesie = 3\n")
    (tmp_path / "few.toml").write_text("samples = 100\n")
    assert main(["train", "--body", *words, "-o", "model", "--quiet"]) == 2
    assert message in capsys.readouterr().err.strip().splitlines()[-1]
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_configurations_that_ship_can_be_read(path: Path) -> None:
    assert read_settings(path, BodyConfig()).name.startswith("body")
