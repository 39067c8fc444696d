"""Control laws."""

import numpy as np
import pytest
from conftest import POSTURE

import fuyu

THESIS = {"k_p": 75.0, "k_o": 100.0, "k_v": [400.0, 100.0, 200.0, 10.0, 2.0, 2.0]}


def into(attitude, vector):
    """Components in base axes, by the rotation matrix."""
    x, y, z, w = attitude
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return R.T @ vector


def multiply(a, b):
    (x, y, z, w), (p, q, r, s) = a, b
    return np.array(
        [
            w * p + x * s + y * r - z * q,
            w * q - x * r + y * s + z * p,
            w * r + x * q - y * p + z * s,
            w * s - x * p - y * q - z * r,
        ]
    )


# The loop of Masutani 1995 chapter 5, closed here: the free-floating servicer brings its tip to a goal in the world.
@pytest.mark.parametrize("law", ["transpose_jacobian", "computed_torque"])
def test_the_tip_reaches_a_goal_in_the_world(servicer, law):
    controller = fuyu.Controller(servicer, law, **THESIS)
    goal = np.array([3.662078985521887, 5.4440225463358125, 0.37996776327278203])
    turn = np.array([0.7701167439055318, 0.2742138532588425, 0.1334195108859386, -0.5602911721169955])
    state, integrator = fuyu.State(servicer, POSTURE), fuyu.Integrator(servicer, "rk4")
    for _ in range(6000):
        R = state.attitude
        back = R * [-1, -1, -1, 1]
        seen = into(R, goal - state.base_position), multiply(back, turn)
        efforts = controller.update(state.time, state.q, state.qd, seen, base_angular_velocity=state.base_angular_velocity)
        integrator.step(state, 0.01, efforts)
    assert controller.report["active"]
    assert np.linalg.norm(state.frame_pose()[0] - goal) < 0.01
    assert np.linalg.norm(controller.report["position_error"]) < 0.01 and controller.report["angle"] < np.radians(2)
    assert np.linalg.norm(state.linear_momentum) == 0.0


def test_without_a_goal_the_joints_are_damped(servicer):
    controller = fuyu.Controller(servicer, "transpose_jacobian", **THESIS)
    qd = np.arange(6) * 0.1
    efforts = controller.update(0.0, POSTURE, qd)
    assert efforts == pytest.approx(-np.array(THESIS["k_v"]) * qd)
    assert controller.report == {
        "active": False,
        "position_error": None,
        "angle": None,
        "position_saturated": False,
        "orientation_saturated": False,
        "convergence_failure": None,
    }


def test_gains_are_computed_if_not_given(servicer):
    controller = fuyu.Controller(servicer)
    assert controller.law == "computed_torque"
    slow = fuyu.Controller(servicer, sample_period=0.1)
    assert controller.gains["k_v"] == pytest.approx(slow.gains["k_v"] * 10)


def test_wrong_settings_and_measurements_are_refused(servicer):
    controller = fuyu.Controller(servicer)
    goal = [1, 2, 3], [0, 0, 0, 1]
    for call, text in [
        (lambda: fuyu.Controller(servicer, "pid"), "law: 'pid' is not one of transpose_jacobian"),
        (lambda: fuyu.Controller(servicer, k_v=[1, 2]), "k_v has 2 values; the robot has 6 joints, so give 6"),
        (lambda: fuyu.Controller(servicer, k_v=[1] * 6, k_p=-1), "k_p is -1; it must be positive and finite"),
        (lambda: fuyu.Controller(servicer, tip="base_link"), "fixed to the base"),
        (lambda: fuyu.Controller(servicer, sample_period=0), "sample_period is 0"),
        (lambda: controller.update(0.0, POSTURE[:5], POSTURE), "`q` has 5 elements"),
        (lambda: controller.update(np.nan, POSTURE, POSTURE), "time is NaN"),
        (lambda: controller.update(0.0, POSTURE, POSTURE, ([1, 2, 3], [0, 0, 0, 2])), "`goal orientation` has the norm 2"),
        (lambda: controller.update(0.0, POSTURE, POSTURE, tip=goal), "give both"),
        (lambda: controller.update(0.0, POSTURE, POSTURE, goal, base_angular_velocity=[0, np.inf, 0]), "finite"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()
