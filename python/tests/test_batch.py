"""Batches: memory, bits, threads, refusals."""

import threading
import time

import numpy as np
import pytest
from conftest import POSTURE

import fuyu


def address(array):
    return array.__array_interface__["data"][0]


def test_states_lie_in_one_array_that_steps_change_in_place(servicer):
    data = np.zeros((50, 2 * 6 + 19))
    data[:] = fuyu.State(servicer, POSTURE).to_row()
    batch = fuyu.Batch(servicer, data=data)
    assert batch.data is data and len(batch) == 50
    places = {name: address(getattr(batch, name)) for name in batch.columns}
    efforts = np.ones((50, 6))
    before = address(data), address(efforts)
    batch.step(0.01, efforts, steps=3)
    assert (address(batch.data), address(efforts)) == before
    # Every view is the same memory as before, inside of the caller's array.
    for name, place in batch.columns.items():
        assert address(getattr(batch, name)) == places[name] == before[0] + 8 * place.start
        assert np.shares_memory(getattr(batch, name), data)
    assert np.allclose(data[:, 0], 0.03) and (batch.q != POSTURE).all()
    out = np.empty((50, 13))
    assert batch.frame_states(out=out) is out
    qdd = np.empty((50, 6))
    assert batch.accelerations(efforts, out=qdd) is qdd
    # Writing to a view changes the states.
    batch.q[:] = 0.0
    assert np.array_equal(batch.state(7).q, np.zeros(6))


# A slice of a larger array: the rest is not touched.
def test_a_batch_may_be_some_rows_of_an_array(servicer):
    data = np.tile(fuyu.State(servicer, POSTURE).to_row(), (30, 1))
    before = data.copy()
    batch = fuyu.Batch(servicer, data=data[10:20])
    batch.step(0.01, np.full(6, 5.0))
    assert np.array_equal(data[:10], before[:10]) and np.array_equal(data[20:], before[20:])
    assert (data[10:20, 1:13] != before[10:20, 1:13]).all()


@pytest.mark.parametrize("method", ["rk4", "dop8"])
def test_every_state_moves_as_alone(servicer, random, method):
    count = 21
    batch = fuyu.Batch(servicer, count, method=method)
    states = []
    for k in range(count):
        state = fuyu.State(servicer, random.uniform(-2, 2, 6), random.normal(size=6) * 0.1, angular_velocity=[0.1, 0, 0.2])
        batch.set_state(k, state)
        states.append(state)
    efforts = random.normal(size=(count, 6)) * 5
    batch.step(0.01, efforts, steps=20)
    qdd = batch.accelerations(efforts)
    frames = batch.frame_states("tool0")
    integrator = fuyu.Integrator(servicer, method)
    for k, state in enumerate(states):
        integrator.step(state, 0.01, efforts[k], steps=20)
        assert batch.state(k) == state
        assert np.array_equal(qdd[k], servicer.forward_dynamics(state, efforts[k]))
        position, turn = state.frame_pose("tool0")
        v, w = state.frame_velocity("tool0")
        assert np.array_equal(frames[k], np.r_[position, turn, v, w])


def test_efforts_are_held_and_limited(servicer):
    weak = fuyu.Model.from_urdf(
        """<robot name="weak"><link name="base_link"><inertial><mass value="10"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="tool0"><inertial><origin xyz="1 0 0"/><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base_link"/><child link="tool0"/><axis xyz="0 0 1"/>
        <limit lower="-9" upper="9" effort="2" velocity="100"/></joint></robot>"""
    )
    limited, asked, held = (fuyu.Batch(weak, 3) for _ in range(3))
    limited.step(0.01, np.full(1, 50.0), steps=2)
    asked.step(0.01, np.full((3, 1), 2.0), steps=2)
    held.step(0.01, np.full(1, 2.0))
    held.step(0.01)
    assert np.array_equal(limited.data, asked.data) and np.array_equal(held.data, asked.data)
    assert (limited.qd > 0).all()


def test_wrong_arrays_are_refused_and_nothing_changes(servicer):
    batch = fuyu.Batch(servicer, 20)
    batch.q[:] = POSTURE
    before = batch.data.copy()
    for call, text in [
        (lambda: batch.step(0.01, np.zeros((19, 6))), r"`efforts` has the shape \[19, 6\]; it must be \(20, 6\) or \(6,\)"),
        (lambda: batch.step(0.01, np.zeros((20, 6), np.float32)), "`efforts` is an array of float32; it must be of float64"),
        (lambda: batch.step(0.01, [0.0] * 6), "`efforts` is a <class 'list'>; it must be a numpy array of float64"),
        (lambda: batch.step(0.01, np.zeros((20, 12))[:, ::2]), "`efforts` is not contiguous"),
        (lambda: batch.step(0.01, np.full((20, 6), np.nan)), "state 0: the effort of joint 'joint1' is NaN"),
        (lambda: batch.step(np.inf, np.zeros(6)), "dt is inf"),
        (lambda: batch.accelerations(out=np.zeros((20, 5))), r"`out` has the shape \[20, 5\]; it must be \[20, 6\]"),
        (lambda: batch.frame_states("hand"), "frame 'hand' is no link"),
        (lambda: batch.state(20), "there is no state 20 in a batch of 20"),
        (lambda: fuyu.Batch(servicer), "give either `count` or `data`"),
        (lambda: fuyu.Batch(servicer, data=np.zeros((4, 30))), r"`data` has the shape \[4, 30\]; it must be \(m, 31\)"),
        (lambda: fuyu.Batch(servicer, data=np.zeros((4, 31), int)), "it must be of float64"),
        (lambda: fuyu.Batch(servicer, data=np.zeros((31, 4)).T), "not contiguous"),
        (lambda: fuyu.Batch(servicer, 3, method="euler"), "'euler' is not one of"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()
    assert np.array_equal(batch.data, before)
    batch.qd[13, 2] = np.nan
    with pytest.raises(fuyu.InputError, match=r"state 13: qd\[2\] is NaN; it must be finite"):
        batch.step(0.01)
    batch.qd[13, 2] = 0.0
    batch.attitude[4] = 0.0
    with pytest.raises(fuyu.InputError, match="state 4: the attitude quaternion has the norm 0"):
        batch.step(0.01)
    read_only = np.zeros((2, 31))
    read_only.flags.writeable = False
    with pytest.raises(fuyu.InputError, match="data"):
        fuyu.Batch(servicer, data=read_only)


def test_mixed_robots_are_refused(servicer):
    other = fuyu.Model.from_urdf("package://fuyu/urdf/ur5.urdf")
    with pytest.raises(fuyu.InputError, match="make both from the same model"):
        fuyu.Batch(servicer, 2).set_state(0, fuyu.State(other))


def test_a_motion_that_diverges_is_named(servicer):
    batch = fuyu.Batch(servicer, 9, method="rk4")
    efforts = np.zeros((9, 6))
    efforts[5] = 1e9
    with pytest.raises(fuyu.RunError, match="has diverged: state 5"):
        batch.step(1.0, efforts, steps=100)


# Would hang or fail if the lock of the interpreter were kept, or if two threads could change the states at once.
def test_steps_release_the_lock_and_one_thread_at_a_time_has_a_batch(servicer):
    batch = fuyu.Batch(servicer, 256, method="rk4")
    batch.q[:] = POSTURE
    refused, done, ticks = [], [], []
    is_over = threading.Event()

    def work():
        for _ in range(30):
            try:
                batch.step(0.01, steps=20)
                done.append(1)
            except RuntimeError as error:
                refused.append(str(error))
                time.sleep(0.001)

    def tick():
        while not is_over.wait(0.0005):
            ticks.append(1)

    clock = threading.Thread(target=tick)
    workers = [threading.Thread(target=work) for _ in range(2)]
    clock.start()
    [w.start() for w in workers]
    [w.join() for w in workers]
    is_over.set()
    clock.join()
    # Every step was either done once or refused.
    assert len(done) + len(refused) == 60 and done
    assert np.allclose(batch.time, 0.01 * 20 * len(done))
    assert all("in use" in text or "borrowed" in text for text in refused), set(refused)
    assert len(ticks) > 5


def test_batches_in_threads_give_the_bits_of_one_thread(servicer, random):
    starts = [random.uniform(-2, 2, (64, 6)) for _ in range(4)]

    def run(q):
        batch = fuyu.Batch(servicer, len(q), method="rk4")
        batch.q[:] = q
        batch.step(0.01, np.full(6, 2.0), steps=50)
        return batch.data

    alone = [run(q) for q in starts]
    found = [None] * 4
    threads = [threading.Thread(target=lambda k=k: found.__setitem__(k, run(starts[k]))) for k in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert all(np.array_equal(a, b) for a, b in zip(alone, found))


# More states than a group of 64. Would fail if a group took the rates of another, or the efforts were not those of each step.
def test_drives_are_as_many_steps_under_their_efforts(servicer, random):
    driven, stepped = fuyu.Batch(servicer, 150, method="rk4"), fuyu.Batch(servicer, 150, method="rk4")
    driven.q[:] = stepped.q[:] = random.uniform(-2, 2, (150, 6))
    rates, gains = random.uniform(-0.1, 0.1, (150, 6)), random.uniform(1, 9, (150, 6))
    driven.servo(0.01, rates, gains, steps=7)
    for _ in range(7):
        stepped.step(0.01, (rates - stepped.qd) * gains)
    assert np.array_equal(driven.data, stepped.data) and (driven.time > 0.069).all()
    # Gains that couple the joints; sums may round differently.
    gains = random.uniform(-1, 1, (150, 6, 6)) + 8.0 * np.eye(6)
    driven.servo(0.01, rates, gains, steps=4)
    for _ in range(4):
        stepped.step(0.01, np.einsum("ijk,ik->ij", gains, rates - stepped.qd))
    assert driven.data == pytest.approx(stepped.data, rel=1e-12, abs=1e-12)
    before = driven.data.copy()
    for wrong, text in [
        ((rates[:9], gains), r"`rates` has the shape \[9, 6\]; it must be \(150, 6\)"),
        ((rates, np.full((150, 6), np.nan)), r"`gains\[0\]` is NaN"),
        ((rates, gains.swapaxes(1, 2)), "`gains` is not contiguous"),
        ((rates, gains[:, :5]), r"`gains` has the shape \[150, 5, 6\]; it must be \(150, 6\) or \(150, 6, 6\)"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            driven.servo(0.01, *wrong)
    assert np.array_equal(driven.data, before)
    # States that diverge are named by their own numbers.
    driven.qd[100] = 1e200
    with pytest.raises(fuyu.RunError, match="diverged: state 100"):
        driven.servo(0.01, rates, gains, steps=3)
