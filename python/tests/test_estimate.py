"""Estimation of a tumbling body. The truth is integrated here, by Euler's equations, without the library's closed form."""

import numpy as np
import pytest

import fuyu

INERTIA = np.array([7.0, 4.0, 3.0])
FOCAL, CENTRE = 1024 / 1.25, 511.5


def product(a, b):
    v = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.r_[v, a[3] * b[3] - a[:3] @ b[:3]]


def rotation(q):
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def tumble(until, step=0.01):
    """Attitudes and angular velocities (camera axes) every half second, by RK4."""
    state = np.r_[0, 0, 0, 1, 0.1, 0.35, 0.2]

    def rate(s):
        q, w = s[:4], s[4:]
        return np.r_[0.5 * product(q, np.r_[w, 0.0]), np.cross(INERTIA * w, w) / INERTIA]

    attitudes, rates = [], []
    for k in range(round(until / step) + 1):
        if k % 50 == 0:
            attitudes.append(state[:4] / np.linalg.norm(state[:4]))
            rates.append(rotation(attitudes[-1]) @ state[4:])
        a = rate(state)
        b = rate(state + step / 2 * a)
        c = rate(state + step / 2 * b)
        d = rate(state + step * c)
        state = state + step / 6 * (a + 2 * b + 2 * c + d)
    return np.array(attitudes), np.array(rates)


@pytest.fixture(scope="module")
def truth():
    return tumble(60.0)


@pytest.fixture(scope="module")
def tracks(truth):
    """Twelve points, 30 s, whole pixels."""
    rows = []
    for k, q in enumerate(truth[0][:61]):
        for i in range(12):
            point = 0.3 * np.array([np.sin(2.1 * i), np.cos(1.3 * i), np.sin(3.7 * i)])
            x, y, z = rotation(q) @ point + [0, 0, 1.5]
            rows.append((0.5 * k, i, round(FOCAL * x / z + CENTRE), round(FOCAL * y / z + CENTRE)))
    return [np.array(column) for column in zip(*rows)]


def angle(a, b):
    return 2 * np.arccos(min(1.0, abs(a @ b)))


def test_the_motion_is_estimated_and_predicted(truth, tracks):
    found = fuyu.estimate(*tracks, fx=FOCAL, cx=CENTRE, cy=CENTRE)
    assert (found.method, found.model) == ("bundle", "asymmetric")
    attitudes, rates = truth
    w = rates[0]
    L, double_energy = rotation(attitudes[0]) @ (INERTIA * (rotation(attitudes[0]).T @ w)), w @ (INERTIA * w)
    assert sorted(found.J) == pytest.approx(sorted(INERTIA / double_energy), rel=0.05)
    assert found.alpha == pytest.approx(L @ L / double_energy**2, rel=0.02)
    assert found.momentum_direction == pytest.approx(L / np.linalg.norm(L), abs=0.02)
    assert found.angular_velocity(10.0) == pytest.approx(rates[20], abs=0.01)
    # The turn from the last frame to half a minute later does not depend on the body axes.
    q = found.attitude([30.0, 60.0])
    assert q.shape == (2, 4)
    conjugate = np.array([-1, -1, -1, 1])
    turn, true_turn = (product(b, a * conjugate) for a, b in [q, (attitudes[60], attitudes[120])])
    assert angle(turn, true_turn) < np.radians(1.0)
    deviation = np.sqrt(np.trace(found.turn_covariance(30.0, 60.0)))
    assert 0 < angle(turn, true_turn) < 5 * deviation
    assert found.covariance.shape == (4, 4)
    ids, points = found.points
    assert sorted(ids) == list(range(12)) and points.shape == (12, 3)
    assert 0.2 < found.rms < 0.6
    times, values = found.angular_velocities
    assert len(times) == 61 and values.shape == (61, 3)


def test_the_camera_may_rotate(truth, tracks):
    # A camera that turns about its optical axis sees the image turn.
    t, ids, u, v = tracks
    spin = 0.05
    a = -spin * t
    x, y = u - CENTRE, v - CENTRE
    seen = np.cos(a) * x - np.sin(a) * y + CENTRE, np.sin(a) * x + np.cos(a) * y + CENTRE
    times = np.linspace(0, 30, 301)
    rates = np.tile([0.0, 0.0, spin], (301, 1))
    found = fuyu.estimate(t, ids, *seen, fx=FOCAL, cx=CENTRE, cy=CENTRE, camera_rates=(times, rates))
    assert found.angular_velocity(10.0) == pytest.approx(truth[1][20], abs=0.01)


def test_what_is_exact_is_not_estimated(tracks):
    exact = {"focal_deviation": 0, "centre_deviation": 0, "radial_deviation": 0, "disturbance": 0}
    found, estimated = (fuyu.estimate(*tracks, fx=FOCAL, cx=CENTRE, cy=CENTRE, **known) for known in [exact, {}])
    assert found.focal_length == pytest.approx(FOCAL, rel=1e-12)
    assert abs(estimated.focal_length - FOCAL) > 1e-6
    # Less is known of a body before a camera that is not calibrated exactly.
    exact, estimated = (np.trace(e.turn_covariance(30.0, 60.0)) for e in [found, estimated])
    assert 0 < exact < estimated


def test_angular_velocities_suffice(truth):
    t = 0.5 * np.arange(121)
    noise = np.random.default_rng(1).normal(0.0, 0.002, (61, 3))
    found = fuyu.estimate_rates(t[:61], truth[1][:61] + noise)
    assert (found.method, found.model) == ("maximum_likelihood", "asymmetric")
    # Predicted for half a minute, and as good as it claims.
    assert found.angular_velocity(t) == pytest.approx(truth[1], abs=0.005)
    conjugate = np.array([-1, -1, -1, 1])
    turn, true_turn = (product(q[1], q[0] * conjugate) for q in [found.attitude([30.0, 60.0]), truth[0][[60, 120]]])
    deviation = np.sqrt(np.trace(found.turn_covariance(30.0, 60.0)))
    assert angle(turn, true_turn) < 4 * deviation < 0.5


def test_the_method_of_the_thesis_is_an_option(truth):
    t = 0.5 * np.arange(121)
    found = fuyu.estimate_rates(t, truth[1], method="masutani1995")
    assert found.method == "masutani1995" and found.turn_covariance(0, 1) is None
    # From 121 samples without noise the thesis's method finds the rates of 0.4 rad/s to 5 %.
    assert found.angular_velocity(t) == pytest.approx(truth[1], abs=0.02)
    assert found.attitude(t).shape == (121, 4)


def test_wrong_tracks_are_refused(tracks):
    t, ids, u, v = tracks
    camera = {"fx": FOCAL, "cx": CENTRE, "cy": CENTRE}
    bad = v.astype(float)
    bad[5] = np.nan
    for call, text in [
        (lambda: fuyu.estimate(t, ids, u, v[:-1], **camera), "`v` has 731 elements, but `t` has 732"),
        (lambda: fuyu.estimate(t, ids, u, bad, **camera), "frame 0 at 0 s: feature 5 is at pixel"),
        (lambda: fuyu.estimate(t[::-1], ids, u, v, **camera), "times must increase"),
        (lambda: fuyu.estimate(t, -ids, u, v, **camera), r"`id\[1\]` is -1"),
        (lambda: fuyu.estimate(t, ids * 0, u, v, **camera), "feature 0 is there twice"),
        (lambda: fuyu.estimate([], [], [], [], **camera), "the tracks are empty"),
        (lambda: fuyu.estimate(t, ids, u, v, fx=-1, cx=0, cy=0), "camera: fx is -1 px; it must be positive"),
        (lambda: fuyu.estimate(t, ids, u, v, method="kalman", **camera), "method: 'kalman' is not one of bundle"),
        (lambda: fuyu.estimate(t, ids, u, v, gyro_bias=-1, **camera), "gyro_bias is -1; it must be zero or positive"),
        (lambda: fuyu.estimate_rates([0, 1], np.ones((2, 3)), method="bundle"), "method: 'bundle' is not one of masut"),
        (lambda: fuyu.estimate_rates(t[:5], np.zeros((5, 2))), r"`w` has the shape \[5, 2\]; it must be \(5, 3\)"),
        (lambda: fuyu.estimate_rates([0, 1, 1], np.ones((3, 3))), r"`times\[2\]` is 1 s"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()
