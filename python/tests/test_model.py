"""Models, Jacobians, momentum, dynamics."""

import copy
import pickle
import threading

import numpy as np
import pytest
from conftest import POSTURE, ROOT

import fuyu

BOOM = """
<robot name="boom">
  <link name="base_link"><inertial><mass value="100"/>
    <inertia ixx="10" iyy="10" izz="10" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
    <inertia ixx="0.1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool0"/>
  <joint name="shoulder" type="revolute"><parent link="base_link"/><child link="arm"/>
    <origin xyz="1 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="3" velocity="4"/></joint>
  <joint name="flange" type="fixed"><parent link="arm"/><child link="tool0"/><origin xyz="1 0 0"/></joint>
</robot>"""


def test_a_description_comes_as_path_name_or_text(servicer):
    assert servicer == fuyu.Model.from_urdf("package://fuyu/urdf/servicer.urdf")
    assert servicer == fuyu.Model.from_urdf(str(ROOT / "urdf/servicer.urdf"))
    assert servicer.joint_names == [f"joint{k}" for k in range(1, 7)]
    assert servicer.dof == 6 and "tool0" in servicer.frame_names
    boom = fuyu.Model.from_urdf(BOOM)
    assert (boom.name, boom.mass) == ("boom", 110.0)
    assert (boom.lower_limits, boom.upper_limits) == ([-1.0], [2.0])
    assert (boom.effort_limits, boom.velocity_limits) == ([3.0], [4.0])
    assert boom != servicer


def test_a_wrong_description_is_an_error_with_its_place():
    with pytest.raises(fuyu.InputError, match="no such file"):
        fuyu.Model.from_urdf("nowhere.urdf")
    with pytest.raises(ValueError, match="my robot.*mass"):
        fuyu.Model.from_urdf(BOOM.replace('mass value="10"', 'mass value="x"'), name="my robot")


# The boom is planar: closed forms from momentum conservation about the common centre of mass.
def test_the_generalized_jacobian_of_a_boom_has_a_closed_form():
    boom = fuyu.Model.from_urdf(BOOM)
    q = 0.7
    J = boom.generalized_jacobian([q])
    # Angular momentum of the reduced two-body problem: base 100 kg at 0, arm 10 kg at (1 + .5 cos q, .5 sin q).
    r = np.array([1 + 0.5 * np.cos(q), 0.5 * np.sin(q)])
    v = np.array([-0.5 * np.sin(q), 0.5 * np.cos(q)])
    m = 100 * 10 / 110
    whole = 10 + 1 + m * r @ r
    arm = 1 + m * (r[0] * v[1] - r[1] * v[0])
    turn = -arm / whole
    assert J[5, 0] == pytest.approx(1 + turn, rel=1e-13)
    assert boom.base_map([q])[5, 0] == pytest.approx(turn, rel=1e-13)
    assert boom.reduced_inertia([q])[0, 0] == pytest.approx(1 + m * v @ v - arm**2 / whole, rel=1e-13)
    assert boom.center_of_mass([q])[:2] == pytest.approx(r * 10 / 110, rel=1e-13)
    fixed = boom.fixed_base_jacobian([q])
    assert fixed[:2, 0] == pytest.approx([-np.sin(q), np.cos(q)], rel=1e-13)


def test_many_postures_give_the_results_of_each(servicer, random):
    q = random.uniform(-3, 3, (5, 7, 6))
    for name, shape in [
        ("generalized_jacobian", (6, 6)),
        ("fixed_base_jacobian", (6, 6)),
        ("base_map", (6, 6)),
        ("reduced_inertia", (6, 6)),
        ("center_of_mass", (3,)),
        ("frame_pose", (7,)),
    ]:
        compute = getattr(servicer, name)
        together = compute(q)
        assert together.shape == (5, 7, *shape) and together.dtype == np.float64
        for i in np.ndindex(5, 7):
            assert np.array_equal(together[i], compute(q[i])), name
        # Any layout, and lists.
        assert np.array_equal(compute(np.asfortranarray(q)), together)
        assert np.array_equal(compute(q[0].tolist()), together[0])
    assert servicer.frame_pose(np.zeros((0, 6))).shape == (0, 7)


def test_the_tip_moves_as_the_generalized_jacobian_says(servicer):
    qd = np.array([0.1, -0.2, 0.3, 0.1, 0.2, -0.1])
    state = fuyu.State(servicer, POSTURE, qd)
    state.linear_momentum = state.angular_momentum = np.zeros(3)
    v, w = state.frame_velocity("tool0")
    assert np.r_[v, w] == pytest.approx(servicer.generalized_jacobian(POSTURE) @ qd, abs=1e-14)
    # The position's difference quotient, from a step without efforts.
    integrator = fuyu.Integrator(servicer)
    ahead, behind = state.copy(), state.copy()
    integrator.step(ahead, 1e-4)
    integrator.step(behind, -1e-4)
    p, _ = ahead.frame_pose()
    p0, _ = behind.frame_pose()
    assert (p - p0) / 2e-4 == pytest.approx(v, abs=1e-8)


def test_formulations_agree_and_inverse_dynamics_inverts(servicer, random):
    state = fuyu.State(
        servicer, POSTURE, random.normal(size=6), velocity=[0.1, 0.2, 0.3], angular_velocity=[0.02, -0.01, 0.03]
    )
    efforts = random.normal(size=6) * 10
    first = servicer.forward_dynamics(state, efforts)
    for formulation in ["reduced", "kane", "newton_euler"]:
        other = servicer.forward_dynamics(state, efforts, formulation=formulation)
        assert other == pytest.approx(first, rel=1e-9)
    assert servicer.inverse_dynamics(state, first) == pytest.approx(efforts, abs=1e-9)


def test_a_wrench_changes_momentum(servicer):
    state = fuyu.State(servicer, POSTURE)
    p, _ = state.frame_pose("base_link")
    com = state.com
    fuyu.Integrator(servicer).step(state, 0.01, wrenches={"base_link": [2, 0, 0, 0, 0, 1]}, steps=1)
    assert state.linear_momentum == pytest.approx([0.02, 0, 0], abs=1e-6)
    torque = np.array([0, 0, 1]) + np.cross(p - com, [2, 0, 0])
    assert state.angular_momentum == pytest.approx(0.01 * torque, abs=1e-5)


def test_momentum_and_state_agree(servicer):
    qd = [0.1, -0.2, 0.3, 0.1, 0.2, -0.1]
    half = np.sqrt(0.5)
    state = fuyu.State(
        servicer,
        POSTURE,
        qd,
        position=[1, 2, 3],
        orientation=[0, 0, half, half],
        velocity=[0.1, 0.2, 0.3],
        angular_velocity=[0.02, -0.01, 0.03],
    )
    assert state.base_position == pytest.approx([1, 2, 3])
    assert state.base_velocity == pytest.approx([0.1, 0.2, 0.3])
    assert state.base_angular_velocity == pytest.approx([0.02, -0.01, 0.03])
    # In base axes, the world's turned by a quarter about z.
    linear, angular = servicer.momentum(POSTURE, qd, [0.2, -0.1, 0.3], [0.02, -0.01, 0.03])
    assert state.linear_momentum == pytest.approx([-linear[1], linear[0], linear[2]])
    assert state.angular_momentum == pytest.approx([-angular[1], angular[0], angular[2]])


def test_free_motion_conserves_momentum_exactly_and_energy_nearly(servicer):
    state = fuyu.State(servicer, POSTURE, np.full(6, 0.2), angular_velocity=[0.1, 0.2, 0.3])
    before, energy = state.copy(), state.kinetic_energy
    fuyu.Integrator(servicer, method="dop8").step(state, 0.01, steps=500)
    assert state.time == pytest.approx(5.0)
    assert np.array_equal(state.linear_momentum, before.linear_momentum)
    assert np.array_equal(state.angular_momentum, before.angular_momentum)
    assert state.kinetic_energy == pytest.approx(energy, rel=1e-11)


def test_states_and_models_are_copied_and_go_to_other_processes(servicer):
    state = fuyu.State(servicer, POSTURE, np.full(6, 0.2), time=3.0)
    for twin in [copy.copy(state), copy.deepcopy(state), pickle.loads(pickle.dumps(state)), state.copy()]:
        assert twin == state and twin is not state
        twin.q = np.zeros(6)
        assert np.array_equal(state.q, POSTURE)
    assert pickle.loads(pickle.dumps(servicer)) == servicer
    assert fuyu.State.from_row(servicer, state.to_row()) == state


def test_wrong_shapes_numbers_and_robots_are_refused(servicer):
    boom = fuyu.Model.from_urdf(BOOM)
    for call, text in [
        (lambda: servicer.generalized_jacobian([0, 1]), r"`q` has 2 elements, but robot `servicer` has 6 joints"),
        (lambda: servicer.generalized_jacobian(1.0), "`q` has 0 elements"),
        (lambda: servicer.generalized_jacobian([np.nan] * 6), r"`q\[0\]` is NaN; it must be finite"),
        (lambda: servicer.generalized_jacobian(POSTURE, "hand"), "frame 'hand' is no link .* tool0"),
        (lambda: fuyu.State(servicer, np.zeros((2, 6))), r"shape \[2, 6\]; it must be \(6,\)"),
        (lambda: fuyu.State(servicer, orientation=[0, 0, 0, 2]), "norm 2"),
        (lambda: fuyu.State(servicer, position=[0, 0]), r"`position` has the shape \[2\]; it must be \(3,\)"),
        (lambda: fuyu.State(servicer, time=np.inf), "time is inf"),
        (lambda: servicer.forward_dynamics(fuyu.State(boom)), r"`servicer` \(6 joints\).*`boom` \(1 joints\)"),
        (lambda: servicer.forward_dynamics(fuyu.State(servicer), formulation="lagrange"), "'lagrange' is not one of"),
        (lambda: fuyu.Integrator(servicer).step(fuyu.State(boom), 0.01), "make both from the same model"),
        (lambda: fuyu.Integrator(servicer).step(fuyu.State(servicer), np.nan), "dt is NaN"),
        (lambda: fuyu.Integrator(servicer, "euler"), "method: 'euler' is not one of dop8, rk4"),
        (lambda: fuyu.State.from_row(servicer, np.zeros(31)), "attitude quaternion has the norm 0"),
        (lambda: fuyu.State.from_row(servicer, np.zeros(30)), r"it must be \(31,\)"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()
    assert issubclass(fuyu.InputError, ValueError) and issubclass(fuyu.RunError, RuntimeError)


def test_a_motion_that_diverges_is_an_error_and_keeps_the_state(servicer):
    state = fuyu.State(servicer, POSTURE)
    before = state.copy()
    with pytest.raises(fuyu.RunError, match="diverges"):
        fuyu.Integrator(servicer, "rk4").step(state, 10.0, np.full(6, 1e6), steps=100)
    assert state == before


def test_a_model_serves_several_threads(servicer, random):
    q = random.uniform(-3, 3, (200, 6))
    expected = servicer.generalized_jacobian(q)
    results = [None] * 4

    def work(k):
        for _ in range(10):
            results[k] = servicer.generalized_jacobian(q)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert all(np.array_equal(r, expected) for r in results)
