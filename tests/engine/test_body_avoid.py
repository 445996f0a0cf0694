"""Whole bodies that keep clear of solids: what must hold of every answer, and of the arithmetic that finds it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cbm_addon.body import contact
from cbm_addon.body.avoid import MARGIN, BodyOptions, BodyResult, avoiding
from cbm_addon.body.contact import Surroundings, planted_feet
from cbm_addon.body.freedom import HINGES, LEAST, MOST, Freedom, _left_jacobian, _turn
from cbm_addon.body.model import ANSWERS, DEFAULT_BODY, TURNING, BodyModel, changes_of, load_body_model, read_card
from cbm_addon.body.sensor import roots, sense
from cbm_addon.body.shape import FILLING, Part, Points, body_shape, standard_parts
from cbm_addon.body.spline import Spline, _solve_banded
from cbm_addon.errors import InputError
from cbm_addon.hands.obstacle import Obstacle, empty, over_time
from cbm_addon.hands.shapes import Box, Cylinder, HalfSpace, Moved, Sphere
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import frame_times, resample
from cbm_addon.motion.rotations import IDENTITY, matrix_from_quat, multiply, quat_from_matrix, quat_from_rotvec, sixd_from_quat
from cbm_addon.motion.skeleton import BODY_JOINTS, STANDARD_BODY, Skeleton
from cbm_addon.progress import Progress, run
from cbm_addon.takes.sample_motion import sample_motion

RATE = 30.0
TRACKED = ("Head", "LeftHand", "RightHand")
FEET = ("LeftFoot", "RightFoot")
MIDDLE = 60  # the frame at which the solids are put in the way
LOW = 0.15  # metres of a beam above the head joint: 8 cm of the head are higher
PIERCED = 0.01  # metres that are called so; a beam that is passed in 0.4 s may keep less, or the body would have to duck faster than bodies do
DEFAULT = BodyOptions()
BODIES = {
    "standard": BODY_JOINTS,
    "another spine": tuple(name for name in BODY_JOINTS if name not in ("Spine1", "Neck")),
    "no shoulders": tuple(name for name in BODY_JOINTS if not name.endswith("Shoulder")),
    "no toes": tuple(name for name in BODY_JOINTS if not name.endswith("Toe")),
}
seeds = st.integers(0, 10_000)
bodies = st.sampled_from(list(BODIES))


def cut(start: float, end: float) -> Motion:
    """A part of the sample motion, which walks from 1.5 to 10.7 s, crouches at 16 and waves at 22."""
    return resample(sample_motion(), frame_times(start, end, RATE))


def on_body(motion: Motion, joints: tuple[str, ...]) -> Motion:
    """The local turns of a motion on the joints that are kept."""
    return Motion(motion.skeleton.subset(joints), motion.times, motion.root, motion.rotations[:, motion.skeleton.indices(joints)])


@pytest.fixture(scope="module")
def walk() -> Motion:
    return cut(2.5, 6.5)


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model(threads=1)


def freed(motion: Motion, obstacles: Callable[[int], Obstacle], options: BodyOptions = DEFAULT, model: BodyModel | None = None) -> BodyResult:
    return run(avoiding(motion, body_shape(motion.skeleton), obstacles, model, options))


def place(motion: Motion, joint: str, frame: int = MIDDLE) -> np.ndarray:
    return motion.positions()[frame, motion.skeleton.index(joint)].astype(np.float64)


def beam(motion: Motion, above: float) -> Box:
    """Across the way of a walk, its underside so far above the head joint."""
    return Box(place(motion, "Head") + [0, 0, above + 0.1], np.array([1.2, 0.1, 0.1]))


def post(motion: Motion) -> Cylinder:
    """Beside the left elbow, as high as a room."""
    return Cylinder(place(motion, "LeftForeArm") + [0.07, 0, 0], 0.05, 3.0)


def ball(motion: Motion) -> Sphere:
    """Floats where the left forearm passes."""
    return Sphere(place(motion, "LeftForeArm") + [0.11, 0, 0], 0.1)


SOLIDS: dict[str, Callable[[Motion], Obstacle]] = {"beam": lambda motion: beam(motion, LOW), "post": post, "ball": ball}


@pytest.fixture(scope="module", params=SOLIDS)
def met(request: pytest.FixtureRequest, walk: Motion) -> tuple[Motion, Obstacle, BodyResult]:
    """A walk, what is in its way, and the answer without networks."""
    solid = SOLIDS[request.param](walk)
    return walk, solid, freed(walk, lambda frame: solid)


def spheres(motion: Motion, part: Part) -> list[tuple[np.ndarray, float]]:
    """Centres [T, 3] and radii of spheres that are strung along a part, by forward kinematics alone."""
    rotations, positions = motion.forward()
    joint, strung = motion.skeleton.index(part.joint), []
    turns = matrix_from_quat(rotations[:, joint].astype(np.float64))
    for beside in (part.beside, -part.beside):
        for share in np.linspace(0, 1, 12):
            centre = part.start + beside + share * (part.end - part.start)
            strung.append((turns @ centre + positions[:, joint], part.radii[0] + share * (part.radii[1] - part.radii[0])))
    return strung


def capsule_depths(motion: Motion, solid: Obstacle) -> np.ndarray:
    """How deep the parts of a body are in a solid [T, parts], metres."""
    parts = (spheres(motion, part) for part in standard_parts(motion.skeleton))
    return np.stack([np.max([radius - solid.nearest(centres.astype(np.float32))[0] for centres, radius in strung], axis=0) for strung in parts], -1)


def arm_depths(motion: Motion) -> np.ndarray:
    """How deep forearms and hands are in the trunk, the head and the legs [T], metres."""
    groups: dict[bool, list[tuple[np.ndarray, float]]] = {True: [], False: []}
    for part in standard_parts(motion.skeleton):
        if not part.joint.endswith(("Shoulder", "LeftArm", "RightArm")):
            groups[part.joint.endswith(("ForeArm", "Hand"))] += spheres(motion, part)
    return np.max([own + other - np.linalg.norm(arm - rest, axis=-1) for arm, own in groups[True] for rest, other in groups[False]], axis=0)


def moved(before: Motion, after: Motion) -> np.ndarray:
    """How far joints were moved [T, J], metres."""
    return np.linalg.norm(after.positions().astype(np.float64) - before.positions(), axis=-1)


# What an answer keeps


def test_what_pierced_is_free(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, solid, result = met
    assert capsule_depths(motion, solid).max() > 2 * PIERCED
    assert capsule_depths(result.motion, solid).max() < (PIERCED if isinstance(solid, Box) else 0.002)
    assert np.maximum(result.after, 0).sum() < 0.1 * np.maximum(result.before, 0).sum()


def test_depths_are_those_of_the_motions(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, solid, result = met
    shape, standing = body_shape(motion.skeleton), planted_feet(motion)
    for given_motion, said in ((motion, result.before), (result.motion, result.after)):
        rotations, positions = given_motion.forward()
        points = np.einsum("tmij,mj->tmi", matrix_from_quat(rotations)[:, shape.axes.joints], shape.axes.offsets) + positions[:, shape.axes.joints]
        depths = shape.radii - solid.nearest(points.reshape(-1, 3).astype(np.float32))[0].reshape(points.shape[:2])
        assert not (standing[:, :, None] & shape.feet & (depths[:, None] > -0.05)).any(), "these solids are far from feet that stand"
        near = np.abs(depths.max(-1)) < 0.1
        assert near.sum() > 5
        np.testing.assert_allclose(said[near], depths.max(-1)[near], atol=1e-4)
        assert (said[~near] < 0).all()


def test_planted_feet_stay(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, _, result = met
    ankles = moved(motion, result.motion)[:, motion.skeleton.indices(FEET)]
    assert ankles[planted_feet(motion)].max() < 0.01


def test_feet_stand_while_the_hips_are_lowered_under_a_beam() -> None:
    """Somebody who stands and looks around, with the top of the head in a beam."""
    standing = cut(11.0, 14.0)
    result = freed(standing, lambda frame: beam(standing, 0.12))
    assert (standing.root[:, 2] - result.motion.root[:, 2]).max() > 0.02
    planted, ankles = planted_feet(standing), moved(standing, result.motion)[:, standing.skeleton.indices(FEET)]
    assert planted.any(0).all()
    assert ankles[planted].max() < 0.01
    assert result.after.max() < 0.003 < 0.05 < result.before.max()


def test_head_and_wrists_that_are_free_stay_with_their_trackers(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, solid, result = met
    depths = capsule_depths(motion, solid)
    parts = np.array([part.joint for part in standard_parts(motion.skeleton)])
    distances, checked = moved(motion, result.motion), 0
    for joint in TRACKED:
        free = (depths[:, parts == joint] < 0).all(-1)
        assert distances[free, motion.skeleton.index(joint)].max() < 0.05
        checked += int((free & (distances.max(-1) > 0)).sum())
    assert checked > 50, "in frames that were changed"


def test_head_hands_and_feet_keep_their_turns(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, _, result = met
    kept = motion.skeleton.indices((*TRACKED, *FEET))
    before, after = (matrix_from_quat(each.forward()[0][:, kept].astype(np.float64)) for each in (motion, result.motion))
    np.testing.assert_allclose(after, before, atol=1e-5)


def test_away_from_the_contact_in_time_nothing_changes_to_the_bit(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, solid, result = met
    near = np.flatnonzero(capsule_depths(motion, solid).max(-1) > -0.01)
    away = np.abs(np.arange(len(motion))[:, None] - near).min(-1) > MARGIN * RATE + 1
    assert 20 < away.sum() < len(motion) - 20
    np.testing.assert_array_equal(result.motion.rotations[away], motion.rotations[away])
    np.testing.assert_array_equal(result.motion.root[away], motion.root[away])
    assert np.any(result.motion.rotations[~away] != motion.rotations[~away])


def test_a_body_that_ducks_keeps_its_balance() -> None:
    """What fills the body has its middle over the same place of the floor."""
    standing = cut(11.0, 14.0)
    result, shape = freed(standing, lambda frame: beam(standing, 0.12)), body_shape(standing.skeleton)

    def middle(motion: Motion) -> np.ndarray:
        rotations, positions = motion.forward()
        points = shape.cloud.world(matrix_from_quat(rotations).astype(np.float64), positions.astype(np.float64))
        return np.einsum("v,tvi->ti", shape.volumes / shape.volumes.sum(), points)[:, :2]

    assert moved(standing, result.motion)[:, 0].max() > 0.05
    assert np.linalg.norm(middle(result.motion) - middle(standing), axis=-1).max() < 0.02


def test_an_arm_that_is_pushed_toward_the_body_does_not_enter_it() -> None:
    """Arms hang beside the thighs, and a ball comes from the left."""
    motion = still()
    for side, sign in (("Left", 1), ("Right", -1)):
        motion.rotations[:, motion.skeleton.index(f"{side}Arm")] = quat_from_rotvec(np.array([0, sign * 1.4, 0]))
    wrist, before = place(motion, "LeftHand", 0), arm_depths(motion)
    result = freed(motion, lambda frame: Sphere(wrist + [0.05, 0, 0.06], 0.12))
    assert -0.07 < before.max() < 0
    assert result.before.max() > 0.02
    assert result.after.max() < 0.003
    assert arm_depths(result.motion).max() < 0.003


def test_corrections_do_not_pop(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, _, result = met
    shift = result.motion.positions().astype(np.float64) - motion.positions()
    assert np.linalg.norm(np.diff(shift, axis=0), axis=-1).max() < 0.04


def bends(motion: Motion) -> np.ndarray:
    """How far elbows and knees are bent [T, 4], radians, negative backwards: about the left-pointing axis of the part above, as it is turned."""
    rotations, positions = motion.forward()
    body, found = motion.skeleton, []
    for hinge, axis in HINGES.items():
        joint = body.index(hinge)
        child, parent = list(body.parents).index(joint), body.parents[joint]
        upper, lower = positions[:, joint] - positions[:, parent], positions[:, child] - positions[:, joint]
        across = np.cross(upper, lower) / (np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1))[:, None]
        about = matrix_from_quat(rotations[:, parent]) @ np.array(axis, np.float32)
        angle = np.arcsin(np.clip(np.linalg.norm(across, axis=-1), 0, 1))
        found.append(np.where((across * about).sum(-1) < 0, -angle, angle))
    return np.stack(found, -1)


def test_elbows_and_knees_never_bend_backwards(met: tuple[Motion, Obstacle, BodyResult]) -> None:
    motion, _, result = met
    changed = np.abs(bends(result.motion) - bends(motion)).max(-1) > 1e-3
    assert changed.any()
    assert bends(motion).min() > 0
    assert bends(result.motion).min() > -0.02


def test_arms_that_are_pushed_from_behind_do_not_break_at_the_elbow() -> None:
    """A ball behind the elbow of an arm that is almost straight: the cheapest way out would bend it backwards."""
    motion = still()
    motion.rotations[:, motion.skeleton.index("LeftForeArm")] = quat_from_rotvec(np.array([0, 0, -0.05]))
    elbow = place(motion, "LeftForeArm", 0)
    result = freed(motion, lambda frame: Sphere(elbow + [0, 0.09, 0], 0.08))
    assert result.before.max() > 0.01
    assert result.after.max() < 0.002
    assert bends(result.motion)[:, list(HINGES).index("LeftForeArm")].min() > 0


def still(frames: int = 30, body: Skeleton = STANDARD_BODY) -> Motion:
    """The T-pose on the floor."""
    root = np.tile(np.array([0, 0, body.height_above_toes("Hips") + 0.025], np.float32), (frames, 1))
    return Motion(body, np.arange(frames) / RATE, root, np.tile(IDENTITY.astype(np.float32), (frames, len(body), 1)))


# When nothing is to be done, and how much


def test_without_obstacle_the_motion_stays_to_the_bit(walk: Motion) -> None:
    result = freed(walk, lambda frame: empty())
    np.testing.assert_array_equal(result.motion.rotations, walk.rotations)
    np.testing.assert_array_equal(result.motion.root, walk.root)
    assert result.after.max() < 0


def test_the_floor_is_in_nobodys_way() -> None:
    """Feet swing low and stand: a floor at the height of the soles changes nothing."""
    walk = cut(2.5, 6.5)
    soles = walk.positions()[:, walk.skeleton.indices(["LeftToe", "RightToe"]), 2].min()
    floor = HalfSpace(np.array([0, 0, soles - 0.025]), np.array([0, 0, 1.0]))
    result = freed(walk, lambda frame: floor)
    np.testing.assert_array_equal(result.motion.rotations, walk.rotations)


def test_strength_goes_from_the_recorded_to_the_free_body(walk: Motion) -> None:
    solid = ball(walk)
    none, half, whole = (freed(walk, lambda frame: solid, BodyOptions(strength=strength)) for strength in (0.0, 0.5, 1.0))
    np.testing.assert_array_equal(none.motion.rotations, walk.rotations)
    np.testing.assert_array_equal(none.motion.root, walk.root)
    np.testing.assert_array_equal(none.after, none.before)
    assert whole.after.max() < half.after.max() < none.after.max()


def test_hold_says_how_strongly_head_and_wrists_stay(walk: Motion) -> None:
    """A post beside the left elbow: the more the wrists are held, the less they give way."""
    solid, wrist = post(walk), walk.skeleton.index("LeftHand")
    given_way = [moved(walk, freed(walk, lambda frame: solid, BodyOptions(hold=hold)).motion)[:, wrist].max() for hold in (0.1, 1.0, 4.0)]
    assert given_way == sorted(given_way, reverse=True)
    assert given_way[0] > 2 * given_way[-1]


def test_a_single_pose_is_freed_too(walk: Motion) -> None:
    pose = Motion(walk.skeleton, walk.times[:1], walk.root[MIDDLE : MIDDLE + 1], walk.rotations[MIDDLE : MIDDLE + 1])
    solid = ball(walk)
    result = freed(pose, lambda frame: solid)
    assert result.before.max() > 0.01
    assert result.after.max() < 0.002


@pytest.mark.parametrize("name", BODIES)
def test_every_body_is_freed_with_the_networks(walk: Motion, model: BodyModel, name: str) -> None:
    motion = on_body(walk, BODIES[name])
    solid = ball(motion)
    result = freed(motion, lambda frame: solid, model=model)
    assert result.before.max() > 0.02
    assert result.after.max() < 0.002


def test_solids_may_move(walk: Motion) -> None:
    """A ball that flies past the elbow; it is asked for once in each frame."""
    start, asked = place(walk, "LeftForeArm") + [0.11, 0, 0], list[int]()

    def passing(frame: int) -> Obstacle:
        asked.append(frame)
        return Moved(Sphere(np.zeros(3), 0.1), (start + [0, 0, 0.04 * (frame - MIDDLE)]).astype(np.float32), IDENTITY.astype(np.float32))

    result = freed(walk, passing)
    assert result.before.max() > 0.02
    assert result.after.max() < 0.002
    assert sorted(asked) == list(range(len(walk)))


# Seeds


def test_the_same_seed_gives_the_same_bytes_and_others_are_free_too(walk: Motion, model: BodyModel) -> None:
    solid = beam(walk, LOW)
    first, again, other = (freed(walk, lambda frame: solid, BodyOptions(seed=seed), model) for seed in (1, 1, 2))
    assert first.motion.rotations.tobytes() == again.motion.rotations.tobytes()
    assert first.motion.root.tobytes() == again.motion.root.tobytes()
    assert max(first.after.max(), other.after.max()) < PIERCED < first.before.max()


def test_without_the_exact_step_the_networks_alone_answer(walk: Motion, model: BodyModel) -> None:
    solid = beam(walk, LOW)
    alone = freed(walk, lambda frame: solid, BodyOptions(exact=False), model)
    assert np.isfinite(alone.motion.rotations).all()
    np.testing.assert_allclose(np.linalg.norm(alone.motion.rotations, axis=-1), 1, atol=1e-5)


def test_the_job_says_how_far_it_is(walk: Motion) -> None:
    events: list[Progress] = []
    run(avoiding(walk, body_shape(walk.skeleton), lambda frame: ball(walk), None, DEFAULT), events.append)
    shares = [event.share for event in events]
    assert shares == sorted(shares)
    assert len(shares) >= 4


# The freedom of a body


def random_changes(freedom: Freedom, rows: int, random: np.random.Generator, size: float = 1.0) -> np.ndarray:
    return random.normal(size=(rows, len(freedom))) * freedom.ease * size


@given(seeds, bodies)
@settings(max_examples=12, deadline=None)
def test_slopes_are_the_derivatives_of_places(walk: Motion, seed: int, name: str) -> None:
    random = np.random.default_rng(seed)
    motion = on_body(walk, BODIES[name])
    freedom = Freedom(motion)
    frames = random.integers(len(motion), size=2)
    changes = random_changes(freedom, 2, random)
    points = Points(random.integers(len(freedom.body), size=40), random.normal(scale=0.1, size=(40, 3)))
    along = random.normal(size=(2, 40, 3))

    def travelled(changes: np.ndarray) -> np.ndarray:
        posed = freedom.posed(frames, changes)
        return (points.world(posed.rotations, posed.positions) * along).sum(-1)

    posed = freedom.posed(frames, changes)
    slopes = freedom.slopes(posed, points.joints, points.world(posed.rotations, posed.positions), along)
    for number in range(len(freedom)):
        step = np.zeros(len(freedom))
        step[number] = 1e-5
        np.testing.assert_allclose(slopes[..., number], (travelled(changes + step) - travelled(changes - step)) / 2e-5, atol=1e-6)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_the_pull_is_half_the_downhill_gradient_of_its_cost(walk: Motion, seed: int) -> None:
    random = np.random.default_rng(seed)
    freedom, solid = Freedom(walk), Sphere(place(walk, "LeftForeArm") + [0.05, 0, 0], 0.1)
    around = Surroundings(freedom, body_shape(walk.skeleton), over_time(lambda frame: solid), hold=1.0)
    frames, changes = np.array([MIDDLE]), random_changes(freedom, 1, random, 0.1)
    direction = random_changes(freedom, 1, random, 1.0)
    pull = around.pull(frames, changes)

    def cost(share: float) -> float:
        return float(around.pull(frames, changes + share * direction, curved=False).cost[0])

    fall = -(cost(1e-4) - cost(-1e-4)) / 2e-4
    assert fall == pytest.approx(2 * float((pull.slope * direction).sum()), rel=0.02, abs=0.02 * abs(float(pull.cost[0])) + 0.1)
    assert np.linalg.eigvalsh(pull.curvature).min() > -1e-6 * np.abs(pull.curvature).max()


def test_rows_are_pulled_alike_however_many_are_looked_at_together(walk: Motion, monkeypatch: pytest.MonkeyPatch) -> None:
    freedom, solid = Freedom(walk), Sphere(place(walk, "LeftForeArm"), 0.3)
    frames = np.arange(len(walk))
    changes = random_changes(freedom, len(walk), np.random.default_rng(0), 0.1)
    pulls = []
    for together in (7, 1000):
        monkeypatch.setattr(contact, "TOGETHER", together)
        pulls.append(Surroundings(freedom, body_shape(walk.skeleton), over_time(lambda frame: solid), hold=1.0).pull(frames, changes))
    for name in ("slope", "curvature", "cost", "depth"):
        np.testing.assert_allclose(getattr(pulls[0], name), getattr(pulls[1], name), rtol=1e-4, atol=1e-4 * np.abs(getattr(pulls[1], name)).max())


@given(seeds, bodies)
@settings(max_examples=20, deadline=None)
def test_changes_are_found_again_from_the_pose_that_they_made(walk: Motion, seed: int, name: str) -> None:
    random = np.random.default_rng(seed)
    motion = on_body(walk, BODIES[name])
    freedom = Freedom(motion)
    frames = random.integers(len(motion), size=3)
    changes = random_changes(freedom, 3, random, 0.3)  # less than half a turn
    posed = freedom.posed(frames, changes)
    np.testing.assert_allclose(freedom.changes_to(frames, posed.rotations, posed.positions[:, 0]), changes, atol=1e-6)


@given(seeds, bodies)
@settings(max_examples=10, deadline=None)
def test_a_changed_motion_is_what_was_posed(walk: Motion, seed: int, name: str) -> None:
    random = np.random.default_rng(seed)
    motion = on_body(walk, BODIES[name])
    freedom = Freedom(motion)
    changes = np.zeros((len(motion), len(freedom)))
    frames = np.sort(random.choice(len(motion), 5, replace=False))
    changes[frames] = random_changes(freedom, 5, random, 0.5)
    changed, posed = freedom.changed(changes), freedom.posed(frames, changes[frames])
    np.testing.assert_allclose(changed.positions()[frames], posed.positions, atol=1e-5)
    np.testing.assert_allclose(matrix_from_quat(changed.forward()[0][frames]), posed.rotations, atol=1e-5)
    others = np.setdiff1d(np.arange(len(motion)), frames)
    np.testing.assert_array_equal(changed.rotations[others], motion.rotations[others])
    assert (changed.rotations * motion.rotations).sum(-1).min() > -1e-6, "no quaternion changes its sign, or curves would turn all the way round"


def test_bends_change_by_what_the_hinges_are_turned(walk: Motion) -> None:
    """Away from straight, a hinge's change is a change of the angle that is seen between the bones."""
    freedom, seen = Freedom(walk), bends(walk)
    bent = np.flatnonzero((seen > 0.3).all(-1) & (seen < 1.2).all(-1))
    assert len(bent)
    changes = np.zeros((len(walk), len(freedom)))
    changes[:, freedom.hinges] = 0.1
    np.testing.assert_allclose(bends(freedom.changed(changes))[bent] - seen[bent], 0.1, atol=1e-3)
    np.testing.assert_allclose(freedom.posed(bent, changes[bent]).bends, seen[bent] + 0.1, atol=1e-3)
    assert LEAST < MOST


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_the_left_jacobian_says_how_a_turn_turns_further(seed: int) -> None:
    random = np.random.default_rng(seed)
    vector = random.normal(size=3) * random.choice([1e-6, 1e-3, 0.3, 2.0])
    for number in range(3):
        step = np.zeros(3)
        step[number] = 1e-5
        further = _turn(vector + step) @ _turn(vector - step).T
        expected = np.array([further[2, 1] - further[1, 2], further[0, 2] - further[2, 0], further[1, 0] - further[0, 1]]) / 2 / 2e-5
        np.testing.assert_allclose(_left_jacobian(vector)[:, number], expected, atol=1e-4)


# Splines over time


def dense_problem(spline: Spline, size: int, random: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Curvatures [count, n, n], slopes [count, n], prior [n] and knots [K, n]."""
    factors = random.normal(size=(spline.count, size, size))
    knots = random.normal(size=(spline.knots, size))
    knots[~moving(spline)] = 0
    return factors @ np.swapaxes(factors, -1, -2), random.normal(size=(spline.count, size)), random.uniform(0.5, 3, size), knots


def moving(spline: Spline) -> np.ndarray:
    """bool [K]: knots that reach no closed end."""
    free = np.ones(spline.knots, bool)
    if not spline.open_start:
        free[:3] = False
    if not spline.open_end:
        free[spline.count // spline.stride :] = False
    return free


@pytest.mark.parametrize(("count", "open_start", "open_end"), [(17, True, True), (16, False, True), (40, False, False), (33, True, False), (1, True, True)])
def test_a_step_is_that_of_a_dense_least_squares_solver(count: int, open_start: bool, open_end: bool) -> None:
    random, limits, size = np.random.default_rng(count), (4.0, 25.0), 3
    spline = Spline(count, RATE, open_start, open_end)
    blocks, pull, prior, knots = dense_problem(spline, size, random)

    def cost(step: np.ndarray) -> float:
        """The change of the cost to second order, written as the docstring says it; without the fixed knots."""
        values = spline.values(step)
        bent = np.einsum("tn,tnm,tm->", values, blocks, values) - 2 * (values * pull).sum()
        return bent + spline.cost(prior, knots + step, limits)

    columns = np.flatnonzero(np.repeat(moving(spline), size))
    units = np.zeros((len(columns), spline.knots * size))
    units[np.arange(len(columns)), columns] = 1
    units = units.reshape(len(columns), spline.knots, size)
    zero = cost(np.zeros_like(knots))
    alone = np.array([cost(unit) for unit in units])
    hessian = np.array([[cost(a + b) - x - y + zero for b, y in zip(units, alone, strict=True)] for a, x in zip(units, alone, strict=True)]) / 2
    gradient = (np.array([cost(unit) - cost(-unit) for unit in units])) / 4
    expected = np.zeros(spline.knots * size)
    expected[columns] = -np.linalg.solve(hessian, gradient)
    found = spline.step(blocks, pull, prior, knots, limits)
    np.testing.assert_allclose(found.reshape(-1), expected, atol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 12])
def test_a_band_is_solved_as_by_a_dense_solver(count: int) -> None:
    random, size, reach = np.random.default_rng(count), 2, 3
    dense = np.zeros((count, size, count, size))
    for k in range(count):
        for d in range(min(reach, count - 1 - k) + 1):
            block = random.normal(size=(size, size))
            dense[k, :, k + d] += block
            dense[k + d, :, k] += block.T
        dense[k, :, k] += 20 * np.eye(size)
    band = np.zeros((reach + 1, count, size, size))
    for d in range(reach + 1):
        for k in range(count - d):
            band[d, k] = dense[k, :, k + d]
    right = random.normal(size=(count, size))
    expected = np.linalg.solve(dense.reshape(count * size, -1), right.reshape(-1)).reshape(count, size)
    np.testing.assert_allclose(_solve_banded(band, right), expected, atol=1e-9)


@given(seeds, st.integers(20, 70))
@settings(max_examples=30, deadline=None)
def test_closed_ends_begin_and_end_at_rest_at_zero(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    spline = Spline(count, RATE, False, False)
    at = np.arange(0, count, 5)
    values = spline.values(spline.knots_near(at, random.normal(size=(len(at), 2))))
    assert values.shape == (count, 2)
    np.testing.assert_array_equal(values[0], 0)
    assert np.abs(values[1]).max() < 0.05
    assert np.abs(values[-1]).max() < 0.05, "the first frame beyond is not changed"


def test_a_spline_follows_what_it_is_near() -> None:
    spline, at = Spline(61, RATE, True, True), np.arange(0, 61, 6)
    wanted = np.sin(np.linspace(0, 3, len(at)))[:, None]
    values = spline.values(spline.knots_near(at, wanted))
    np.testing.assert_allclose(values[at], wanted, atol=0.05)
    constant = spline.values(np.ones((spline.knots, 1)))
    np.testing.assert_allclose(constant, 1, atol=1e-12)
    assert np.abs(np.diff(values, 3, axis=0)).max() < 0.01


# The shape of a body


def capsule_volume(part: Part) -> float:
    """Of the spheres that roll from the start to the end of a tapered capsule: a frustum between the two circles in which they touch it, and two caps."""
    length, (first, second) = float(np.linalg.norm(part.end - part.start)), part.radii
    slope = (first - second) / length
    lean = np.sqrt(1 - slope**2)
    low, high = first * slope, length + second * slope
    wide, narrow = first * lean, second * lean
    frustum = np.pi * (high - low) / 3 * (wide**2 + wide * narrow + narrow**2)

    def cap(radius: float, height: float) -> float:
        return np.pi * height**2 * (3 * radius - height) / 3

    return frustum + cap(first, first + low) + cap(second, second - second * slope)


@pytest.mark.parametrize("radii", [(0.1, 0.1), (0.09, 0.06), (0.05, 0.05)])
@pytest.mark.parametrize("length", [0.1, 0.4])
def test_the_cloud_of_a_capsule_has_its_volume(radii: tuple[float, float], length: float) -> None:
    part = Part("Hips", np.zeros(3), np.array([0, 0, length]), radii, np.zeros(3))
    shape = body_shape(STANDARD_BODY, [part])
    assert shape.volumes.sum() == pytest.approx(capsule_volume(part), rel=0.04)
    assert len(shape.volumes) <= FILLING
    heights = shape.cloud.offsets[:, 2]
    axis = np.clip(heights, 0, length)
    apart = np.hypot(np.linalg.norm(shape.cloud.offsets[:, :2], axis=-1), heights - axis)
    assert (apart < np.interp(axis / length, (0, 1), radii)).all()
    assert shape.cloud.offsets.mean(0)[:2] == pytest.approx([0, 0], abs=0.01)


def test_a_wide_part_is_two_capsules_that_share_a_volume() -> None:
    wide = Part("Hips", np.zeros(3), np.array([0, 0, 0.2]), (0.1, 0.1), np.array([0.05, 0, 0]))
    shape = body_shape(STANDARD_BODY, [wide])
    assert shape.volumes.sum() == pytest.approx(capsule_volume(wide), rel=0.04)
    assert set(np.sign(shape.axes.offsets[:, 0])) == {-1.0, 1.0}


@pytest.mark.parametrize("name", BODIES)
def test_feet_that_stand_on_a_floor_are_not_in_it(name: str) -> None:
    body = STANDARD_BODY.subset(BODIES[name])
    shape = body_shape(body, sole=0.02)
    rest = body.rest_positions()
    floor = min(rest[body.index(joint), 2] for joint in ("LeftFoot", "LeftToe") if joint in body) - 0.02
    lowest = rest[shape.axes.joints, 2] + shape.axes.offsets[:, 2] - shape.radii
    assert shape.feet.any(-1).all()
    assert (lowest[shape.feet.any(0)] >= floor - 1e-6).all()
    assert (shape.radii > 0).all()
    assert not (shape.feet[0] & shape.feet[1]).any()


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_parts_grow_with_the_body(scale: float) -> None:
    for small, large in zip(standard_parts(STANDARD_BODY), standard_parts(STANDARD_BODY.scaled(scale)), strict=True):
        assert small.joint == large.joint
        for name in ("start", "end", "radii", "beside"):
            np.testing.assert_allclose(getattr(large, name), scale * np.array(getattr(small, name)), rtol=1e-5, atol=1e-7)
    one, other = body_shape(STANDARD_BODY), body_shape(STANDARD_BODY.scaled(scale))
    np.testing.assert_allclose(other.axes.offsets, scale * one.axes.offsets, rtol=1e-4, atol=1e-6)
    assert other.volumes.sum() == pytest.approx(scale**3 * one.volumes.sum(), rel=0.01)


def test_a_body_weighs_what_a_body_weighs() -> None:
    """A person of 1.75 m has 60 to 90 litres; parts overlap a little at the joints."""
    assert 50 < 1000 * body_shape(STANDARD_BODY).volumes.sum() < 100


# The networks


def test_the_shipped_model_loads_and_is_small(model: BodyModel) -> None:
    assert sum(entry["bytes"] for entry in model.card["files"].values()) < 5e6
    assert sum(path.stat().st_size for path in DEFAULT_BODY.iterdir()) < 5e6
    assert model.grid.count > 1000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "cbm-body 0"}, "another format"),
        ({"format": "cbm-hands 1"}, "another format"),
        ({"channels": None}, "lacks channels"),
        ({"places": ["Head"]}, "'places' differs"),
        ({"rotations": ["Hips"]}, "'rotations' differs"),
    ],
)
def test_a_card_that_does_not_fit_is_refused_in_one_line(tmp_path: Path, change: dict, message: str) -> None:
    card = json.loads((DEFAULT_BODY / "card.json").read_text())
    for key, value in change.items():
        if value is None:
            del card[key]
        elif key in card["features"]:
            card["features"][key] = value
        else:
            card[key] = value
    (tmp_path / "card.json").write_text(json.dumps(card))
    with pytest.raises(InputError, match=message) as caught:
        read_card(tmp_path)
    assert "\n" not in str(caught.value)


def test_networks_that_were_changed_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "body"
    shutil.copytree(DEFAULT_BODY, folder)
    with (folder / "body.decoder.onnx").open("ab") as file:
        file.write(b"x")
    with pytest.raises(InputError, match="checksum differs"):
        load_body_model(folder)


def test_models_of_hands_and_of_the_controller_are_not_of_bodies() -> None:
    for name in ("base", "hands"):
        with pytest.raises(InputError, match="another format"):
            read_card(DEFAULT_BODY.parent / name)


@pytest.mark.parametrize("name", BODIES)
def test_networks_propose_for_every_body(walk: Motion, model: BodyModel, name: str) -> None:
    motion = on_body(walk, BODIES[name])
    freedom, solid, frames = Freedom(motion), ball(walk), np.array([0, MIDDLE, 100])
    unit = body_shape(motion.skeleton).unit
    first, again, other = (model.propose(freedom, unit, over_time(lambda frame: solid), frames, 3, seed) for seed in (1, 1, 2))
    assert len(first) == 3
    assert first[0].shape == (3, len(freedom))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[0], other[0])  # the likeliest code does not depend on the seed
    assert np.abs(np.array(first[1:]) - other[1:]).max() > 0


def test_an_answer_that_is_the_recorded_pose_changes_nothing(walk: Motion) -> None:
    """Seen from the root, the turns of the pose itself, and no shift."""
    freedom, frames = Freedom(walk), np.array([3, MIDDLE])
    seen = np.swapaxes(roots(freedom, frames)[1], -1, -2)[:, None] @ freedom.world[frames][:, walk.skeleton.indices(TURNING)]
    answers = np.concatenate((np.zeros((2, 3)), sixd_from_quat(quat_from_matrix(seen)).reshape(2, -1)), -1)
    assert answers.shape[1] == ANSWERS
    np.testing.assert_allclose(changes_of(freedom, 1.6, frames, answers), 0, atol=1e-4)
    answers[:, 0] = 0.1  # to the left
    left = matrix_from_quat(walk.rotations[frames, 0])[..., 0] * [1, 1, 0]
    shift = changes_of(freedom, 1.6, frames, answers)[:, :3]
    np.testing.assert_allclose(np.linalg.norm(shift, axis=-1), 0.16, atol=1e-6)
    np.testing.assert_allclose((shift / 0.16 * left / np.linalg.norm(left, axis=-1, keepdims=True)).sum(-1), 1, atol=0.05)


def test_bodies_of_any_size_and_place_sense_the_same(walk: Motion, model: BodyModel) -> None:
    frames, solid = np.array([MIDDLE]), ball(walk)
    turn = quat_from_rotvec(np.array([0, 0, 2.0]))
    seen = []
    for scale, turned, shift in ((1.0, IDENTITY, np.zeros(3)), (1.7, turn, np.array([3.0, -2, 0]))):
        matrix, rotations = matrix_from_quat(turned), walk.rotations.copy()
        rotations[:, 0] = multiply(turned, rotations[:, 0])
        motion = Motion(walk.skeleton.scaled(scale), walk.times, (scale * walk.root @ matrix.T + shift).astype(np.float32), rotations)
        other = Sphere(scale * matrix @ solid.centre + shift, scale * solid.radius)
        seen.append(sense(model.grid, Freedom(motion), body_shape(motion.skeleton).unit, over_time(lambda frame, other=other: other), frames))
    assert 0 < seen[0][:, : model.grid.count].mean() < 0.2
    np.testing.assert_allclose(seen[1], seen[0], atol=0.02)
