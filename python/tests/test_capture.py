"""Latches between robots and targets, and the environments of capture."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.vector import AutoresetMode  # noqa: E402

import fuyu  # noqa: E402
import fuyu.gym  # noqa: E402

POSITION, ORIENTATION = [-0.75, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]


def momentum(*batches):
    """Linear momentum of all batches together, angular momentum about the world's origin, and a size of the latter; each row a pair."""
    linear = sum(b.linear_momentum for b in batches)
    orbital = [np.cross(b.com, b.linear_momentum) for b in batches]
    angular = sum(b.angular_momentum for b in batches) + sum(orbital)
    size = sum(np.linalg.norm(b.angular_momentum, axis=1) + np.linalg.norm(o, axis=1) for b, o in zip(batches, orbital))
    return linear.copy(), angular, size


def energy(batch):
    return np.array([batch.state(k).kinetic_energy for k in range(len(batch))])


@pytest.fixture
def latches(servicer, random):
    """Five moving servicers whose tips are where the grasp frames of five tumbling satellites are."""
    from conftest import POSTURE

    client = fuyu.Model.from_urdf("package://fuyu/urdf/client.urdf")
    robots, targets = fuyu.Batch(servicer, 5), fuyu.Batch(client, 5)
    for k in range(5):
        q, qd = POSTURE + random.uniform(-0.3, 0.3, 6), random.normal(size=6) * 0.02
        spin = random.normal(size=3) * 0.01
        robots.set_state(k, fuyu.State(servicer, q, qd, position=[1, k, 2], velocity=[0.01, 0, 0], angular_velocity=spin))
    latches = fuyu.Latches(robots, targets, position=POSITION, orientation=ORIENTATION)
    tips = robots.frame_states()
    latches.place_targets(np.arange(5), tips[:, :7], random.normal(size=(5, 3)) * 0.02, random.normal(size=(5, 3)) * 0.05)
    return latches


def test_targets_are_placed_at_the_tips(latches):
    assert latches.grasp_states()[:, :3] == pytest.approx(latches.robots.frame_states()[:, :3], abs=1e-12)
    before = latches.separations()
    assert abs(before[:, :6]).max() < 1e-12 and (abs(before[:, 6:]) > 1e-4).all()
    # Velocities are those of the frames.
    grasps, tips = latches.grasp_states(), latches.robots.frame_states()
    assert before[:, 6:] == pytest.approx(grasps[:, 7:] - tips[:, 7:], abs=1e-15)
    # The rotation vector turns the tip's axes to those of the grasp frame: about the tip's z axis by 0.2 rad.
    pose = latches.robots.frame_states()[:1, :7]
    x, y, z, w = pose[0, 3:]
    s, c = np.sin(0.1), np.cos(0.1)
    pose[0, 3:] = [x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s]
    latches.place_targets([0], pose, np.zeros((1, 3)), np.zeros((1, 3)))
    axis = [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]
    assert latches.separations()[0, 3:6] == pytest.approx(0.2 * np.array(axis), abs=1e-12)


# Would fail if the impulse acted on one body only, about another point, or if rows were not written back.
def test_a_latch_conserves_momentum_and_loses_its_energy(latches):
    robots, targets = latches.robots, latches.targets
    before, relative = momentum(robots, targets), latches.separations()[:, 6:]
    own, energies = robots.linear_momentum.copy(), energy(robots) + energy(targets)
    impulses = latches.close(range(5))
    after = momentum(robots, targets)
    assert (np.linalg.norm(after[0] - before[0], axis=1) <= 1e-12 * np.linalg.norm(before[0], axis=1)).all()
    assert (np.linalg.norm(after[1] - before[1], axis=1) <= 1e-12 * before[2]).all()
    assert abs(latches.separations()).max() < 1e-12
    assert robots.linear_momentum - own == pytest.approx(impulses[:, :3], abs=1e-11)
    lost = energies - energy(robots) - energy(targets)
    assert impulses[:, 6] == pytest.approx(lost, abs=1e-12 * energies.max())
    # Carnot: half of the impulse times the relative velocity that it removes.
    assert impulses[:, 6] == pytest.approx(0.5 * np.einsum("ij,ij->i", impulses[:, :6], relative), rel=1e-9)
    assert (impulses[:, 6] > 1e-4).all() and latches.closed.all()


# Would fail if robot and target went on separately.
def test_a_closed_latch_holds(latches):
    robots, targets = latches.robots, latches.targets
    latches.close([1, 3], distance=1e-9, angle=1e-9)
    before = momentum(robots, targets)
    efforts = np.random.default_rng(2).normal(size=(5, 6)) * 5.0
    for _ in range(30):
        latches.step(0.01, efforts, steps=10)
    assert robots.time == pytest.approx(np.full(5, 3.0)) and targets.time == pytest.approx(np.full(5, 3.0))
    gaps = abs(latches.separations()).max(axis=1)
    assert (gaps[[1, 3]] < 1e-10).all() and (gaps[[0, 2, 4]] > 0.01).all()
    assert (abs(robots.qd[[1, 3]]) > 1e-3).any()
    after = momentum(robots, targets)
    assert (np.linalg.norm(after[0] - before[0], axis=1) <= 1e-12 * np.linalg.norm(before[0], axis=1)).all()
    assert (np.linalg.norm(after[1] - before[1], axis=1) <= 1e-11 * before[2]).all()
    # Opened, both go on as they move.
    motion = robots.data.copy()
    latches.open([1])
    assert np.array_equal(robots.data, motion) and latches.closed.tolist() == [False, False, False, True, False]
    latches.step(0.01, np.tile([3.0, -2.0, 1.0, 1.0, 0.5, -0.5], (5, 1)), steps=100)
    assert abs(latches.separations()).max(axis=1)[1] > 1e-4


# Would fail if the drives of a pair that is joined were not sampled in each step, or took the rates of another.
def test_drives_move_joined_pairs_as_steps_do(latches, random):
    rates, gains = random.uniform(-0.1, 0.1, (5, 6)), random.uniform(1, 9, (5, 6))
    start = latches.robots.data.copy(), latches.targets.data.copy()
    moved = []
    for drive in [True, False]:
        latches.open(range(5))
        latches.robots.data[:], latches.targets.data[:] = start
        latches.close([0, 3], distance=1e-9, angle=1e-9)
        if drive:
            latches.servo(0.01, rates, gains, steps=20)
        else:
            for _ in range(20):
                latches.step(0.01, (rates - latches.robots.qd) * gains)
        moved.append((latches.robots.data.copy(), latches.targets.data.copy()))
    for driven, stepped in zip(*moved):
        assert driven == pytest.approx(stepped, rel=1e-12, abs=1e-12)
    assert (abs(moved[0][0] - start[0]).max(axis=1) > 1e-3).all()


def test_wrong_input_of_latches_is_refused(latches, servicer):
    client = latches.targets.model
    few = fuyu.Batch(client, 4)
    nothing = np.zeros((1, 3))
    pose = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    latches.close([2])
    far = latches.robots.frame_states()[:1, :7] + np.array([[0.02, 0, 0, 0, 0, 0, 0]])
    latches.place_targets([0], far, nothing, nothing)
    data = latches.robots.data.copy(), latches.targets.data.copy()
    for call, text in [
        (lambda: fuyu.Latches(latches.robots, latches.robots), "robots and targets are the same Batch"),
        (lambda: fuyu.Latches(latches.robots, few), "there are 5 robots and 4 targets"),
        (lambda: fuyu.Latches(latches.robots, latches.targets, tip="hand"), "hand"),
        (lambda: fuyu.Latches(latches.robots, latches.targets, kind="glue"), "kind: 'glue' is not one of weld, ball"),
        (lambda: fuyu.Latches(latches.robots, latches.targets, orientation=[0, 0, 0, 2]), "`orientation` has the norm 2"),
        (lambda: latches.close([5]), "there is no pair 5 among 5"),
        (lambda: latches.close([1, 1]), "pair 1 is given twice"),
        (lambda: latches.close([1, 2]), "the latch of pair 2 is closed already"),
        (lambda: latches.close([1, 0]), r"pair 0: the frames of the grasp are 0\.0200 m and 0\.0000 rad apart; at most 0\.01 m"),
        (lambda: latches.close([1], distance=-1.0), "distance is -1"),
        (lambda: latches.place_targets([1], pose[:, :6], nothing, nothing), r"`poses` has the shape \[1, 6\]; it must be \(1, 7\)"),
        (lambda: latches.place_targets([1], 2.0 * pose, nothing, nothing), r"the quaternion of poses\[0\] has the norm 2"),
        (lambda: latches.place_targets([1], pose, nothing * np.nan, nothing), r"`velocities\[0\]` is NaN"),
        (lambda: latches.step(0.01, np.zeros((4, 6))), r"`efforts` has the shape \[4, 6\]"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()
    assert np.array_equal(latches.robots.data, data[0]) and np.array_equal(latches.targets.data, data[1])
    assert latches.closed.tolist() == [False, False, True, False, False]


def servo(task, seen, gain=0.5, speed=0.2):
    """Rates that bring the tip to the grasp frame, from observations alone: velocity of the grasp frame plus a share of the gap."""
    q, rest = seen[:, :6] + task.posture, seen[:, 12:].reshape(len(seen), 6, 3)
    error, _, velocity, turn, _, spin = rest.transpose(1, 0, 2)
    approach = gain * error
    approach *= np.minimum(1.0, speed / np.maximum(np.linalg.norm(approach, axis=1), 1e-9))[:, None]
    twist = np.concatenate([velocity + approach, spin + 0.5 * turn], axis=1)
    J = task.model.generalized_jacobian(q.astype(float), task.tip)
    damped = J @ J.transpose(0, 2, 1) + 1e-4 * np.eye(6)
    rates = np.einsum("ijk,ij->ik", J, np.linalg.solve(damped, twist[:, :, None])[:, :, 0]) / task.max_rate
    return rates / np.maximum(1.0, abs(rates).max(axis=1))[:, None]


def episodes(envs, policy, seed):
    """One episode of each environment: which ones captured, and the infos of the captures."""
    seen, _ = envs.reset(seed=seed)
    over, captured, last = np.zeros(envs.num_envs, bool), np.zeros(envs.num_envs, bool), [None] * envs.num_envs
    while not over.all():
        seen, rewards, terminated, truncated, infos = envs.step(policy(envs.task, seen))
        for k in np.flatnonzero(terminated & ~over):
            last[k] = {name: values[k] for name, values in infos.items()} | {"reward": rewards[k]}
        captured |= terminated & ~over
        over |= terminated | truncated
    return captured, last


def many(count=64, **settings):
    return fuyu.gym.CaptureVectorEnv(count, autoreset_mode=AutoresetMode.DISABLED, **settings)


def test_a_servo_captures_and_rest_does_not():
    captured, infos = episodes(many(), servo, 1)
    assert captured.mean() > 0.8
    for info in (info for info in infos if info is not None):
        assert info["is_success"] and info["latch"] == "closed"
        # 0.03 m/s on an effective mass of some 30 kg, and turns on its lever.
        assert 0 < np.linalg.norm(info["impulse"][:3]) < 5 and info["energy_lost"] > 0
        # What remains of the speed is that of turning with the body, some 0.05 rad/s on 3 cm.
        assert info["speed"] < 0.003 and info["rate"] < 1e-12 and info["reward"] > 0
    captured, infos = episodes(many(), lambda task, seen: np.zeros((64, 6)), 1)
    assert captured.mean() < 0.05


# The bodies that differ in mass are those that differ in the physics.
def test_dispersed_bodies_are_captured():
    randomization = {
        "mass_scale": {"uniform": {"min": 0.8, "max": 1.2}},
        "target_mass_scale": {"log_normal": {"sigma": 0.5}},
        "target_angular_velocity": {"normal": {"sigma": 0.02}},
        "target_velocity": {"uniform": {"min": -0.005, "max": 0.005}},
        "base_angular_velocity": {"normal": {"sigma": 0.001}},
        "robots": 3,
    }
    envs = many(24, randomization=randomization)
    captured, _ = episodes(envs, servo, 2)
    assert len({latches.targets.model.mass for _, latches in envs.task.latches}) == 3
    assert captured.mean() > 0.7


def test_momentum_does_not_change_in_a_capture():
    envs = many()
    seen, _ = envs.reset(seed=3)
    ((_, latches),) = envs.task.latches
    before = momentum(latches.robots, latches.targets)
    for _ in range(120):
        seen, *_ = envs.step(servo(envs.task, seen))
    assert envs.task.terminated.sum() > 32
    after = momentum(latches.robots, latches.targets)
    assert (np.linalg.norm(after[0] - before[0], axis=1) <= 1e-12 * np.linalg.norm(before[0], axis=1)).all()
    assert (np.linalg.norm(after[1] - before[1], axis=1) <= 1e-12 * before[2]).all()
    # Without resets, what is captured goes on as one body.
    gap, _, velocity, rate = latches.separations()[envs.task.terminated].reshape(-1, 4, 3).transpose(1, 0, 2)
    spin = latches.grasp_states()[envs.task.terminated, 10:]
    assert np.linalg.norm(gap, axis=1).max() <= 0.03 and abs(rate).max() < 1e-12
    assert velocity == pytest.approx(np.cross(spin, gap), abs=1e-12)


def test_a_fast_approach_is_no_capture():
    envs = many(16, success_angle=3.0, success_rate=3.0)
    seen, _ = envs.reset(seed=4)
    met = np.zeros(16, bool)
    for _ in range(120):
        # At full speed until the last centimetres.
        seen, _, terminated, _, infos = envs.step(servo(envs.task, seen, gain=4.0, speed=0.12))
        near = (infos["distance"] <= 0.03) & ~met
        fast = near & (infos["speed"] > 0.03)
        assert not terminated[fast].any() and (infos["latch"][fast] == "speed").all()
        assert (infos["latch"][(infos["distance"] > 0.03) & ~terminated] == "distance").all()
        met |= fast
    assert met.sum() > 4


# The next episode begins with an open latch and another body.
def test_episodes_begin_again_after_a_capture():
    envs = fuyu.gym.CaptureVectorEnv(16, autoreset_mode=AutoresetMode.SAME_STEP)
    seen, _ = envs.reset(seed=1)
    for _ in range(200):
        seen, rewards, terminated, truncated, infos = envs.step(servo(envs.task, seen))
        assert not (terminated & truncated).any()
        if terminated.any():
            break
    k = int(np.flatnonzero(terminated)[0])
    assert infos["final_info"]["is_success"][k] and infos["final_info"]["latch"][k] == "closed" and rewards[k] > 0
    assert not infos["is_success"][k] and infos["latch"][k] != "closed" and not infos["impulse"][k].any()
    ((_, latches),) = envs.task.latches
    assert not latches.closed.any() and envs.task.steps[k] == 0 and envs.task.distance[k] > 0.05


def test_wrong_settings_of_a_capture_are_refused():
    for settings, text in [
        ({"success_speed": 0.0}, "success_speed is 0.0; it must be positive"),
        ({"randomization": {"target_mass": 1.0}}, "there is no 'target_mass'; there are posture"),
        ({"target": "urdf/nothing.urdf"}, "nothing.urdf"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            fuyu.gym.CaptureEnv(**settings)
    with pytest.raises(fuyu.InputError, match="target_mass_scale is -1.0; it must be positive"):
        fuyu.gym.CaptureEnv(randomization={"target_mass_scale": -1.0}).reset()
