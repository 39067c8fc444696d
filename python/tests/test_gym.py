"""Gymnasium environments."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

import fuyu  # noqa: E402
import fuyu.gym  # noqa: E402

EVERYTHING = {
    "base_angular_velocity": {"normal": {"sigma": 0.01}},
    "effort_scale": {"uniform": {"min": 0.9, "max": 1.1}},
    "observation_noise": {"truncated_normal": {"sigma": 0.01, "min": -0.02, "max": 0.02}},
    "mass_scale": {"log_normal": {"sigma": 0.1}},
    "goal_offset": {"choice": [-0.2, 0.2]},
    "robots": 3,
}


@pytest.mark.parametrize("name", ["fuyu/Reach-v0", "fuyu/Track-v0", "fuyu/Capture-v0"])
@pytest.mark.parametrize("randomization", [None, EVERYTHING])
@pytest.mark.filterwarnings("error::UserWarning:gymnasium")
def test_gymnasium_accepts_the_environments(name, randomization):
    env = gymnasium.make(name, randomization=randomization)
    check_env(env.unwrapped, skip_render_check=True)


def rollout(envs, seed, steps=25):
    observations, _ = envs.reset(seed=seed)
    random = np.random.default_rng(3)
    seen = [observations]
    for _ in range(steps):
        observations, rewards, _, _, _ = envs.step(random.uniform(-1, 1, envs.action_space.shape))
        seen += [observations, rewards]
    return seen


@pytest.mark.parametrize("name", ["fuyu/Reach-v0", "fuyu/Track-v0", "fuyu/Capture-v0"])
@pytest.mark.parametrize("randomization", [None, EVERYTHING])
def test_a_seed_determines_everything(name, randomization):
    make = lambda: gymnasium.make_vec(name, 12, "vector_entry_point", randomization=randomization, episode_steps=10)  # noqa: E731
    first, again, other = make(), make(), make()
    a, b, c = rollout(first, 5), rollout(again, 5), rollout(other, 6)
    assert all(np.array_equal(x, y) for x, y in zip(a, b))
    assert not np.array_equal(a[0], c[0])
    # Also of one that has run before.
    assert all(np.array_equal(x, y) for x, y in zip(rollout(first, 5), a))
    assert first.observation_space.contains(a[-2]) and a[-1].shape == (12,)


# One environment of many moves as alone: its first episode, from the same state.
@pytest.mark.parametrize("kind", ["Reach", "Track", "Capture"])
def test_many_environments_move_as_one(kind):
    many = getattr(fuyu.gym, f"{kind}VectorEnv")(5)
    one = getattr(fuyu.gym, f"{kind}Env")()
    many.reset(seed=1)
    one.reset(seed=2)
    for name in ["data", "goal", "goal_velocity", "axis", "arm", "drift", "start", "spin", "targets"]:
        if hasattr(one.task, name):
            getattr(one.task, name)[:] = getattr(many.task, name)[3:4]
    random = np.random.default_rng(3)
    for _ in range(20):
        actions = random.uniform(-1, 1, (5, 6))
        seen, rewards, *_, infos = many.step(actions)
        alone, reward, terminated, truncated, info = one.step(actions[3])
        assert np.array_equal(seen[3], alone) and not terminated and not truncated
        # Sums over rows may round differently in arrays of other lengths.
        assert rewards[3] == pytest.approx(reward, rel=1e-12)
        assert infos["distance"][3] == pytest.approx(info["distance"], rel=1e-12)


def test_observations_are_what_they_say(servicer):
    env = fuyu.gym.ReachEnv(randomization={"base_angular_velocity": 0.02})
    env.reset(seed=4)
    for _ in range(5):
        seen, *_, info = env.step(np.full(6, 0.5))
    state = env.task.batches[0][1].state(0)
    error = env.task.goal[0] - state.frame_pose()[0]
    assert np.linalg.norm(error) == pytest.approx(info["distance"])
    x, y, z, w = state.attitude
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert abs(R - np.eye(3)).max() > 0.005
    assert seen[:6] == pytest.approx(state.q - env.task.posture, abs=1e-6)
    assert seen[6:12] == pytest.approx(state.qd / 0.15, abs=1e-6)
    assert seen[12:15] == pytest.approx(R.T @ error, abs=1e-6)
    assert seen[15:18] == pytest.approx(R.T @ state.frame_velocity()[0], abs=1e-6)
    assert (state.linear_momentum != 0).any()


# The goal of Track moves with the velocity that is observed, on a circle about a drifting centre.
def test_the_tracked_point_moves_as_observed():
    envs = fuyu.gym.TrackVectorEnv(50)
    envs.reset(seed=1)
    before = envs.task.goal.copy()
    envs.step(np.zeros((50, 6)))
    velocity = envs.task.goal_velocity.copy()
    envs.step(np.zeros((50, 6)))
    assert (envs.task.goal - before) / 0.2 == pytest.approx(velocity, abs=1e-4)
    speed = np.linalg.norm(velocity, axis=1)
    assert (speed > 0.002).all() and (speed < 0.07).all()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_episodes_begin_again_as_gymnasium_prescribes(mode):
    envs = fuyu.gym.ReachVectorEnv(4, autoreset_mode=mode, episode_steps=5)
    envs.reset(seed=1)
    first = envs.task.goal.copy()
    for k in range(1, 6):
        seen, _, terminated, truncated, infos = envs.step(np.ones((4, 6)))
        assert truncated.all() == (k == 5) and not terminated.any()
    if mode == AutoresetMode.SAME_STEP:
        assert infos["_final_obs"].all() and infos["final_info"]["distance"].shape == (4,)
        assert not np.array_equal(infos["final_obs"][2], seen[2])
    else:
        assert np.array_equal(envs.task.goal, first)
        seen, rewards, _, truncated, _ = envs.step(np.ones((4, 6)))
        assert not truncated.any() and (rewards == 0).all()
    assert (envs.task.goal != first).all() and (envs.task.steps == 0).all()
    assert seen[:, 6:12] == pytest.approx(np.zeros((4, 6)))


def test_robots_differ_in_mass():
    envs = fuyu.gym.ReachVectorEnv(9, randomization={"mass_scale": {"uniform": {"min": 0.5, "max": 2.0}}, "robots": 3})
    envs.reset(seed=1)
    masses = [batch.model.mass for _, batch in envs.task.batches]
    assert len(set(masses)) == 3
    assert [rows for rows, _ in envs.task.batches] == [slice(0, 3), slice(3, 6), slice(6, 9)]


# With the centre of mass of another robot the base would be elsewhere, by centimetres.
@pytest.mark.parametrize("spin", [0.0, 0.01])
def test_the_base_begins_at_the_origin_whatever_the_masses(spin):
    masses = {"mass_scale": {"uniform": {"min": 0.5, "max": 2.0}}, "robots": 3, "base_angular_velocity": spin}
    envs = fuyu.gym.ReachVectorEnv(9, randomization=masses)

    def positions():
        return [batch.state(k).base_position for rows, batch in envs.task.batches for k in range(rows.stop - rows.start)]

    # Of robots that have not begun yet as well.
    envs.reset(seed=1, options={"reset_mask": np.arange(9) % 2 == 0})
    assert np.abs(positions()).max() < 1e-12
    envs.reset()
    assert np.abs(positions()).max() < 1e-12


# A mask resets some environments only: the others keep robot and motion, also with a seed.
def test_a_mask_leaves_other_robots_alone():
    envs = fuyu.gym.ReachVectorEnv(4, randomization={"mass_scale": {"uniform": {"min": 0.5, "max": 2.0}}, "robots": 4})
    envs.reset(seed=1)
    envs.step(np.ones((4, 6)))
    mask = np.array([False, True, False, True])
    masses, before = [batch.model.mass for _, batch in envs.task.batches], envs.task.data.copy()
    envs.reset(seed=2, options={"reset_mask": mask})
    assert [batch.model.mass for _, batch in envs.task.batches] == masses
    assert np.array_equal(envs.task.data[~mask], before[~mask]) and (envs.task.steps == [1, 0, 1, 0]).all()
    assert not np.array_equal(envs.task.data[mask], before[mask])
    # None and all are the same.
    first, _ = envs.reset(seed=3)
    again, _ = envs.reset(seed=3, options={"reset_mask": np.ones(4, dtype=bool)})
    assert np.array_equal(first, again) and [batch.model.mass for _, batch in envs.task.batches] != masses
    seen, _ = envs.reset(options={"reset_mask": np.zeros(4, dtype=bool)})
    assert np.array_equal(seen, again)


def test_wrong_settings_and_actions_are_refused():
    env = fuyu.gym.ReachEnv()
    env.reset(seed=0)
    envs = fuyu.gym.ReachVectorEnv(3)
    envs.reset(seed=0)

    def posture(dispersion):
        fuyu.gym.ReachEnv(randomization={"posture": dispersion}).reset()

    for call, text in [
        (lambda: fuyu.gym.ReachEnv(max_rate=0), "max_rate is 0; it must be positive"),
        (lambda: fuyu.gym.ReachEnv(randomization={"mass": 1}), "there is no 'mass'; there are posture"),
        (lambda: posture({"gauss": {}}), "posture: 'gauss' is not one of uniform"),
        (lambda: posture({"uniform": {"min": 1}}), "uniform has no max; it has min, max"),
        (lambda: posture({"uniform": {"min": 2, "max": 1}}), "min must be below max"),
        (lambda: posture({"normal": {"sigma": -1}}), "a standard deviation is not negative"),
        (lambda: posture({"normal": {"sigma": np.nan}}), "sigma is nan; it must be finite"),
        (lambda: posture({"truncated_normal": {"sigma": 1, "min": 90, "max": 91}}), "hardly any sample"),
        (lambda: posture({"truncated_normal": {"sigma": 1}}), "neither min nor max; give one of them"),
        (lambda: posture({"truncated_normal": {"sigma": 1, "max": np.inf}}), "max is inf; it must be finite"),
        (lambda: posture("wide"), "posture is 'wide'; it must be a number"),
        (lambda: fuyu.gym.ReachEnv(randomization={"mass_scale": -1.0}).reset(), "it must be positive"),
        (lambda: env.step(np.zeros(5)), r"`action` has the shape \(5,\); it must be \(6,\)"),
        (lambda: env.step(np.full(6, np.nan)), "not finite"),
        (lambda: envs.step(np.zeros((2, 6))), r"it must be \(3, 6\)"),
        (lambda: envs.reset(options={"reset_mask": np.ones(4, dtype=bool)}), r"has the shape \(4,\).*it must be \(3,\), bool"),
        (lambda: envs.reset(options={"reset_mask": [0, 1, 1]}), "the type int64; it must be"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()


def test_dispersions_have_their_moments():
    random = np.random.default_rng(1)
    draw = lambda dispersion: fuyu.gym.disperse("x", dispersion, random, (40_000,))  # noqa: E731
    # Standard errors are below 0.01.
    normal = draw({"normal": {"mean": 2.0, "sigma": 0.5}})
    assert normal.mean() == pytest.approx(2.0, abs=0.02) and normal.std() == pytest.approx(0.5, abs=0.02)
    uniform = draw({"uniform": {"min": 1.0, "max": 3.0}})
    assert uniform.min() >= 1 and uniform.max() <= 3 and uniform.std() == pytest.approx(2 / np.sqrt(12), abs=0.02)
    cut = draw({"truncated_normal": {"sigma": 1.0, "min": -1.0, "max": 1.0}})
    # Variance of a normal distribution cut at one deviation.
    assert abs(cut).max() <= 1 and cut.std() == pytest.approx(0.5396, abs=0.02)
    # Half of a normal distribution.
    half = draw({"truncated_normal": {"sigma": 1.0, "min": 0.0}})
    assert half.min() >= 0 and half.mean() == pytest.approx(np.sqrt(2 / np.pi), abs=0.02)
    assert draw({"truncated_normal": {"sigma": 1.0, "max": 0.0}}).max() <= 0
    log = draw({"log_normal": {"median": 3.0, "sigma": 0.2}})
    assert np.median(log) == pytest.approx(3.0, abs=0.03) and np.log(log).std() == pytest.approx(0.2, abs=0.01)
    assert set(draw({"choice": [1, 4]})) == {1.0, 4.0} and (draw(7.0) == 7.0).all()
