"""Training: resumable to the same result, exported as it was trained, split by clip, and honest about what it cannot use."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from cbm_addon.errors import InputError  # noqa: E402
from cbm_addon.features import LOWER_BODY, LOWER_JOINTS, MODES, RATE, STANDARD_PROPORTIONS, network_input, tracker_frames  # noqa: E402
from cbm_addon.learn.config import TrainConfig, read_config  # noqa: E402
from cbm_addon.learn.dataset import Dataset, clip_frames, faces_one_way, join, read_body_motion, stands_on_a_floor  # noqa: E402
from cbm_addon.learn.export import export  # noqa: E402
from cbm_addon.learn.job import train_model  # noqa: E402
from cbm_addon.learn.manner import manners  # noqa: E402
from cbm_addon.learn.networks import CodebookMatching, matching_loss, sample_codes  # noqa: E402
from cbm_addon.learn.rivals import ConditionalVae  # noqa: E402
from cbm_addon.learn.split import CORE_SPLIT, read_split, split_of  # noqa: E402
from cbm_addon.learn.start import start_from  # noqa: E402
from cbm_addon.learn.training import build, importance, train_mode  # noqa: E402
from cbm_addon.motion.bvh import write_bvh  # noqa: E402
from cbm_addon.motion.contacts import CONTACT_JOINTS  # noqa: E402
from cbm_addon.motion.mirror import mirror  # noqa: E402
from cbm_addon.motion.motion import Motion  # noqa: E402
from cbm_addon.motion.resample import frame_times, resample  # noqa: E402
from cbm_addon.motion.rotations import multiply  # noqa: E402
from cbm_addon.motion.skeleton import Skeleton  # noqa: E402
from cbm_addon.progress import run  # noqa: E402
from cbm_addon.solve.models import Model, load_model  # noqa: E402
from cbm_addon.takes.sample_motion import sample_motion  # noqa: E402
from cbm_addon.takes.synthesize import synthesize  # noqa: E402

CONFIG = TrainConfig(name="test", channels=4, classes=4, hidden=16, blocks=1, code_blocks=1, epochs=2, batch=64, modes=("lookahead",))
MODE = MODES["lookahead"]


@pytest.fixture(scope="module")
def data(body_motion: Motion) -> dict[str, Dataset]:
    return {"train": join([clip_frames("a", body_motion), clip_frames("a", mirror(body_motion))]), "validation": join([clip_frames("b", body_motion)])}


def test_a_resumed_run_ends_where_an_unbroken_one_does(data: dict[str, Dataset], tmp_path: Path) -> None:
    whole = run(train_mode(data, MODE, CONFIG, tmp_path / "whole.npz", False))
    job = train_mode(data, MODE, CONFIG, tmp_path / "broken.npz", False)
    for event in job:
        if "epoch 1:" in event.message:
            break
    job.close()
    resumed = run(train_mode(data, MODE, CONFIG, tmp_path / "broken.npz", True))
    for a, b in zip(whole.modules().parameters(), resumed.modules().parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_a_checkpoint_of_another_configuration_is_refused(data: dict[str, Dataset], tmp_path: Path) -> None:
    run(train_mode(data, MODE, CONFIG, tmp_path / "checkpoint.npz", False))
    with pytest.raises(InputError, match="another configuration"):
        run(train_mode(data, MODE, replace(CONFIG, hidden=24), tmp_path / "checkpoint.npz", True))


def test_the_exported_networks_compute_what_the_trained_ones_do(data: dict[str, Dataset], tmp_path: Path) -> None:
    networks = run(train_mode(data, MODE, CONFIG, tmp_path / "checkpoint.npz", False))
    export([networks], tmp_path / "model", {"name": "test", "version": "0", "licence": "none", "training": {"clips": {"train": 1}}})
    loaded = load_model(tmp_path / "model").networks("lookahead")
    frames = np.arange(0, 100, 10)
    windows, _, _ = data["validation"].batch(frames, MODE)
    codes = np.arange(10 * 4).reshape(10, 4) % 4
    stats = networks.statistics
    x = stats["window"].normalise(torch.from_numpy(network_input(windows, data["validation"].proportions[frames])))
    one_hot = torch.nn.functional.one_hot(torch.from_numpy(codes), 4).float()
    with torch.no_grad():
        features = networks.trunk(x)
        expected = {
            "control": stats["control"].restore(networks.control(features)),
            "logits": networks.lower_body.logits(networks.lower_body.estimator, features),
            "lower body": stats["lower_body"].restore(networks.lower_body.decode(one_hot, features)),
        }
    estimate = loaded.estimate(windows, STANDARD_PROPORTIONS)
    found = {"control": estimate.control, "logits": estimate.logits, "lower body": loaded.decode(codes, estimate.features)}
    for name, values in expected.items():  # fp16 and 8-bit weights: half a hundredth of the values' size, as a whole and at the worst number
        truth = values.numpy().ravel()
        error = found[name].ravel() - truth
        assert np.linalg.norm(error) < 0.005 * np.linalg.norm(truth), name
        assert np.abs(error).max() < 0.005 * np.abs(truth).max(), name


def test_training_goes_on_from_what_a_model_holds(data: dict[str, Dataset], tmp_path: Path) -> None:
    trained = run(train_mode(data, MODE, CONFIG, tmp_path / "checkpoint.npz", False))
    facts = {"name": "test", "version": "0", "licence": "none", "training": {"clips": {"train": 1}}}
    export([trained], tmp_path / "model", facts)
    fresh = build(data["train"], MODE, replace(CONFIG, seed=2))
    start_from(tmp_path / "model", fresh)
    fresh.history = trained.history
    export([fresh], tmp_path / "again", facts)
    first, again = (load_model(tmp_path / name).networks("lookahead") for name in ("model", "again"))
    windows = data["validation"].batch(np.arange(0, 100, 10), MODE)[0]
    for a, b in zip(vars(first.estimate(windows, STANDARD_PROPORTIONS)).values(), vars(again.estimate(windows, STANDARD_PROPORTIONS)).values(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)  # what was stored in 8 bits is stored in the same 8 bits again
    with pytest.raises(InputError, match="other sizes"):
        start_from(tmp_path / "model", build(data["train"], MODE, replace(CONFIG, hidden=24)))


def test_training_on_gives_a_mean_of_before_and_after_and_keeps_other_modes(small_model_folder: Path, tmp_path: Path, body_motion: Motion) -> None:
    write_bvh(tmp_path / "own.bvh", body_motion)
    before = load_model(small_model_folder)
    for keep in (0.0, 0.5, 1.0):
        config = TrainConfig(name="mine", modes=("lookahead",), channels=4, classes=4, hidden=32, epochs=1, batch=32, keep=keep)
        run(train_model([tmp_path / "own.bvh"], tmp_path / f"kept {keep}", config, False, False, small_model_folder))
    models = {keep: load_model(tmp_path / f"kept {keep}") for keep in (0.0, 0.5, 1.0)}
    take, anchors = tracker_frames(synthesize(body_motion), 1.6)

    def answer(model: Model, mode: str) -> np.ndarray:
        windows = take.seen_from(anchors[np.arange(5)], np.arange(5)[:, None] + np.array(MODES[mode].window))
        return model.networks(mode).estimate(windows, STANDARD_PROPORTIONS).control

    np.testing.assert_allclose(answer(models[1.0], "lookahead"), answer(before, "lookahead"), atol=1e-2)
    gone = {keep: np.abs(answer(model, "lookahead") - answer(before, "lookahead")).mean() for keep, model in models.items()}
    assert gone[1.0] < gone[0.5] < gone[0.0]
    np.testing.assert_allclose(answer(models[0.5], "causal"), answer(before, "causal"), atol=1e-2)
    np.testing.assert_array_equal(models[0.5].networks("causal").manners, before.networks("causal").manners)


def test_manners_are_what_whole_clips_are_off_by(data: dict[str, Dataset], body_motion: Motion, tmp_path: Path) -> None:
    networks = run(train_mode(data, MODE, CONFIG, tmp_path / "checkpoint.npz", False))
    truth = data["validation"].lower_body
    bent = truth.vectors.copy()
    bent[:, LOWER_JOINTS.index("Hips"), 2] -= 0.5
    other = replace(data["validation"], lower_body=replace(truth, vectors=bent))
    found = manners(other, networks)
    assert found.shape[1:] == (len(LOWER_JOINTS), 3)
    lengths = np.linalg.norm(found.reshape(len(found), -1), axis=-1)
    assert (np.diff(lengths) <= 0).all()
    assert abs(found[0, LOWER_JOINTS.index("Hips"), 2]) == pytest.approx(0.5, abs=0.15)


def test_causally_near_frames_and_contacts_count_most_and_looking_ahead_all_count_alike() -> None:
    assert (importance(MODES["lookahead"]) == 1).all()
    counts = importance(MODES["causal"]).unflatten(0, (-1, LOWER_BODY.size))
    assert counts.mean().item() == pytest.approx(1)
    assert (counts.diff(dim=0) < 0).all(), "an earlier frame counts more"
    assert (counts[:, -len(CONTACT_JOINTS) :].min(1).values > counts[:, : -len(CONTACT_JOINTS)].max(1).values).all()


def test_what_does_not_count_is_not_learnt() -> None:
    torch.manual_seed(0)
    net = CodebookMatching(2, 2, 1, 2, hidden=16, dropout=0.0)
    x, y = torch.randn(64, 2), torch.randn(64, 2)
    net.losses(x, y, "kl", torch.tensor([2.0, 0.0]))[0].backward()
    gradient = net.decoder[-1].weight.grad
    assert gradient[0].abs().sum() > 0
    assert gradient[1].abs().sum() == 0


def test_windows_never_cross_into_another_clip(body_motion: Motion) -> None:
    still = replace(body_motion, root=body_motion.root * 0 + body_motion.root[:1], rotations=body_motion.rotations[:1].repeat(len(body_motion), 0))
    data = join([clip_frames("still", still), clip_frames("moving", body_motion)])
    last = np.array([len(body_motion) - 1])
    window, _, _ = data.batch(last, MODE)
    np.testing.assert_allclose(window, window[:, :1].repeat(window.shape[1], 1), atol=1e-6)


def test_rare_behaviour_is_drawn_more_often_than_it_is_there() -> None:
    motion = sample_motion()
    train = join([clip_frames("walks and crouches", resample(motion, frame_times(0, 36, RATE)))])
    low = train.trackers.vectors[:, 0, 2] < 0.8
    drawn = np.concatenate(list(train.drawn(64, 1)))
    assert 0 < low.mean() < 0.5
    assert low[drawn].mean() > 1.1 * low.mean()
    np.testing.assert_array_equal(drawn, np.concatenate(list(train.drawn(64, 1))))


def test_a_clip_whose_head_is_below_the_floor_is_left_out(body_motion: Motion) -> None:
    assert stands_on_a_floor(body_motion)
    assert not stands_on_a_floor(replace(body_motion, root=body_motion.root - np.array([0, 0, 2], np.float32)))


def test_a_clip_with_its_head_or_arms_on_backwards_is_left_out(body_motion: Motion) -> None:
    skeleton = body_motion.skeleton
    assert faces_one_way(body_motion)
    for names in (("Head",), ("LeftShoulder", "RightShoulder")):
        turned = body_motion.rotations.copy()
        for joint in skeleton.indices(list(names)):
            turned[:, joint] = multiply(turned[:, joint], np.array([0, 0, 0, 1], np.float32))
        assert not faces_one_way(replace(body_motion, rotations=turned)), names


def test_codes_are_one_hot_and_follow_the_logits() -> None:
    torch.manual_seed(0)
    logits = torch.log(torch.tensor([0.7, 0.2, 0.1])).expand(20000, 1, 3)
    codes = sample_codes(logits)
    assert torch.equal(codes.round().sum(-1), torch.ones(20000, 1))
    torch.testing.assert_close(codes.mean(0)[0], torch.tensor([0.7, 0.2, 0.1]), atol=0.02, rtol=0)


@pytest.mark.parametrize("kind", ["kl", "probabilities", "paper"])
def test_matching_draws_encoder_and_estimator_together(kind: str) -> None:
    torch.manual_seed(0)
    encoder, estimator = (torch.randn(256, 3, 4, requires_grad=True) for _ in range(2))
    matching_loss(kind, encoder, estimator).backward()
    assert encoder.grad is not None
    assert estimator.grad is not None
    assert encoder.grad.abs().sum() > 0
    assert estimator.grad.abs().sum() > 0
    same = torch.randn(256, 3, 4) * 20  # nearly certain: the samples agree too
    assert matching_loss(kind, same, same) < matching_loss(kind, same, same.roll(1, 0))


def test_codebook_matching_separates_the_branches_of_an_ambiguous_function() -> None:
    """Appendix A in miniature: y = +x or -x. A regressor says 0; sampled codes must say one of the two."""
    torch.manual_seed(1)
    net = CodebookMatching(1, 1, 4, 4, 64, 0.0)
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3)
    for _ in range(1200):
        x = torch.rand(256, 1) * 0.5 + 0.5
        y = x * (torch.randint(0, 2, (256, 1)) * 2 - 1)
        reconstruction, matching = net.losses(x, y, "kl")
        optimiser.zero_grad()
        (reconstruction + 0.05 * matching).backward()
        optimiser.step()
    net.eval()
    x = torch.rand(2000, 1) * 0.5 + 0.5
    with torch.no_grad():
        drawn = net.decode(sample_codes(net.logits(net.estimator, x)), x)
    coherent = ((drawn.abs() - x).abs() < 0.25 * x).float().mean()
    assert coherent > 0.9
    assert 0.3 < (drawn > 0).float().mean() < 0.7


def test_clips_with_other_joints_are_refused_with_the_list(tmp_path: Path) -> None:
    nan = np.full((2, 3), np.nan, np.float32)
    skeleton = Skeleton(("Hips", "Spine"), np.array([-1, 0]), np.array([[0, 0, 1], [0, 0, 0.2]], np.float32), nan)
    quats = np.zeros((60, 2, 4), np.float32)
    quats[..., 0] = 1
    write_bvh(tmp_path / "short.bvh", Motion(skeleton, np.arange(60) / 30, np.zeros((60, 3), np.float32), quats))
    with pytest.raises(InputError, match=r"short\.bvh.*LeftUpLeg.*RightToe"):
        read_body_motion(tmp_path / "short.bvh")


def test_the_committed_split_is_by_clip_and_by_performer() -> None:
    split = read_split()
    counts = {name: sum(value == name for value in split.values()) for name in ("train", "validation", "test")}
    assert counts["test"] >= 20
    assert counts["validation"] >= 20
    second_player = {value for stem, value in split.items() if re.fullmatch(r"snu_basketball__s_\d+_\d+_2(_s\d)?", stem)}
    assert second_player - {"unused"} == {"validation", "test"}
    assert '"by": "performer"' in CORE_SPLIT.read_text()


def test_clips_outside_the_split_file_are_divided_the_same_way_everywhere() -> None:
    names = [f"clip{i}" for i in range(1000)]
    shares = [split_of(name, {}) for name in names]
    assert shares == [split_of(name, {}) for name in names]
    assert 850 < shares.count("train") < 950


def test_a_configuration_that_cannot_be_meant_is_refused(tmp_path: Path) -> None:
    for text, said in (("chanels = 3", "chanels"), ("hidden = 'many'", "hidden"), ("epochs =", "not a training configuration")):
        (tmp_path / "config.toml").write_text(text)
        with pytest.raises(InputError, match=said):
            read_config(tmp_path / "config.toml")


RIVALS = {
    "regressor": {"channels": 1, "classes": 1},
    "conditional VAE": {"latent": "gaussian"},
    "continuous latent": {"latent": "continuous"},
    "no sampling": {"sampled": False},
    "not end to end": {"end_to_end": False},
    "the paper's loss, codes alone": {"matching": "paper", "decoder_sees_window": False},
}


@pytest.mark.parametrize("rival", RIVALS)
def test_every_rival_is_exported_as_codes_and_a_decoder(rival: str, data: dict[str, Dataset], tmp_path: Path) -> None:
    networks = run(train_mode(data, MODE, replace(CONFIG, epochs=1, **RIVALS[rival]), tmp_path / "checkpoint.npz", False))
    export([networks], tmp_path / "model", {"name": "test", "version": "0", "licence": "none", "training": {"clips": {"train": 1}}})
    loaded, net = load_model(tmp_path / "model").networks("lookahead"), networks.lower_body
    windows, _, _ = data["validation"].batch(np.arange(0, 100, 10), MODE)
    estimate = loaded.estimate(windows, STANDARD_PROPORTIONS)
    codes = np.random.default_rng(0).integers(loaded.classes, size=(10, loaded.channels))
    with torch.no_grad():
        one_hot = torch.nn.functional.one_hot(torch.from_numpy(codes), loaded.classes).float()
        expected = networks.statistics["lower_body"].restore(net.decode(one_hot, torch.from_numpy(estimate.features)))
    np.testing.assert_allclose(loaded.decode(codes, estimate.features).reshape(10, -1), expected.numpy(), atol=5e-3)


def test_the_latent_of_the_vae_is_drawn_from_a_normal_distribution() -> None:
    net = ConditionalVae(inputs=3, outputs=2, hidden=8, dropout=0.0, blocks=1)
    codes = sample_codes(net.logits(net.estimator, torch.zeros(500, 3)))
    drawn = (codes.flatten(-2) @ net.table.T).flatten()
    assert abs(float(drawn.mean())) < 0.02
    assert abs(float(drawn.std()) - 1) < 0.03


def test_an_encoder_that_does_not_feel_the_matching_learns_from_reconstruction_alone() -> None:
    net = CodebookMatching(2, 2, 3, 4, 8, 0.0)
    net.end_to_end = False
    _, matching = net.losses(torch.randn(16, 2), torch.randn(16, 2), "kl")
    matching.backward()
    assert all(parameter.grad is None for parameter in net.encoder.parameters())
    assert any(parameter.grad is not None for parameter in net.estimator.parameters())
