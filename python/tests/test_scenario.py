"""Scenarios, and recordings as tables."""

import concurrent.futures
import json
import pickle
import subprocess
import warnings

import numpy as np
import pytest
from conftest import ROOT

import fuyu


def of_the_command_line(command, *arguments):
    ran = subprocess.run([command, "simulate", *arguments, "--json"], capture_output=True, text=True, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def without_wall_time(result):
    if "robots" in result:
        return {name: without_wall_time(robot) for name, robot in result["robots"].items()}
    return {key: value for key, value in result.items() if key != "wall_time"}


@pytest.mark.parametrize("name", ["positioning", "tracking", "two_servicers", "tr942_chain"])
def test_a_run_has_the_bits_of_the_command_line(command, name):
    scenario = fuyu.Scenario(name)
    assert scenario.name == name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = scenario.simulate(2.0)
    expected = of_the_command_line(command, f"config/{name}.yaml", "--duration", "2")
    assert without_wall_time(found) == without_wall_time(expected)


def test_parameters_may_be_replaced(command, tmp_path):
    text = (ROOT / "config/positioning.yaml").read_text()
    changed = text.replace("k_p: 75.0", "k_p: 60.0").replace("law: transpose_jacobian", "law: joint_pd")
    changed = changed.replace("time_step: 0.01", "time_step: 0.005")
    assert changed != text
    (tmp_path / "changed.yaml").write_text(changed)
    expected = of_the_command_line(command, str(tmp_path / "changed.yaml"), "--duration", "2")
    scenario = fuyu.Scenario(ROOT / "config/positioning.yaml")
    changes = {"controller": {"k_p": 60.0, "law": "joint_pd"}, "dynamics": {"time_step": np.float64(0.005)}}
    by_node = scenario.simulate(2.0, **changes)
    by_name = scenario.simulate(
        2.0, parameters={"controller.k_p": 60.0, "controller.law": "joint_pd", "dynamics.time_step": 0.005}
    )
    assert without_wall_time(by_node) == without_wall_time(by_name) == without_wall_time(expected)
    moved = scenario.simulate(0.1, camera={"goal": {"position": np.array([3.6, 5.4, 0.4])}})
    assert moved["tip_position_error"] != scenario.simulate(0.1)["tip_position_error"]


def test_scenarios_run_in_threads_and_other_processes():
    scenario = fuyu.Scenario("positioning")
    expected = without_wall_time(scenario.simulate(1.0))
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        runs = [pool.submit(scenario.simulate, 1.0) for _ in range(6)]
        assert all(without_wall_time(run.result()) == expected for run in runs)
    assert without_wall_time(pickle.loads(pickle.dumps(scenario)).simulate(1.0)) == expected


def test_wrong_scenarios_and_parameters_are_refused(tmp_path):
    scenario = fuyu.Scenario("positioning")
    for call, text in [
        (lambda: fuyu.Scenario("position"), "position.yaml: not found"),
        (lambda: fuyu.Scenario("nowhere.yaml"), "nowhere.yaml: no such file"),
        (lambda: scenario.simulate(-1.0), "duration is -1; it must be positive"),
        (lambda: scenario.simulate(1.0, controller={"k_q": 1.0}), "no such parameter; did you mean k_"),
        (lambda: scenario.simulate(1.0, controller={"k_p": "much"}), "k_p .*is a string, expected a double"),
        (lambda: scenario.simulate(1.0, controler={"k_p": 1.0}), "does not name the node 'controler'"),
        (lambda: scenario.simulate(1.0, parameters={"k_p": 1.0}), "k_p is not a parameter; give NODE.PARAMETER"),
        (lambda: scenario.simulate(1.0, controller={"k_p": object()}), "is no ROS parameter"),
        (lambda: scenario.simulate(1.0, controller={"k_v": [1.0, 2.0]}), "k_v has 2 values"),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()


def test_a_bag_is_arrow_tables(tmp_path):
    pytest.importorskip("pyarrow")
    result = fuyu.Scenario("positioning").simulate(1.0, output=tmp_path / "run")
    bag = fuyu.Bag(tmp_path / "run")
    assert bag.topics["/joint_states"] == "sensor_msgs/msg/JointState"
    states = bag.table("/joint_states")
    assert states.num_rows == bag.counts["/joint_states"] == 101
    last = states.slice(100).to_pylist()[0]
    names = [last[f"name[{k}]"] for k in range(6)]
    positions = {name: last[f"position[{k}]"] for k, name in enumerate(names)}
    assert positions == result["final"]["q"]
    tables = bag.tables()
    assert set(tables) <= set(bag.topics) and len(tables) > 5
    with pytest.raises(fuyu.InputError, match="has no topic /joint_state; it has .*joint_states"):
        bag.table("/joint_state")
    with pytest.raises(fuyu.InputError, match="nothing"):
        fuyu.Bag(tmp_path / "nothing")
