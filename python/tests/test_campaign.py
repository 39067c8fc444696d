"""Campaigns: the same runs as by the command line, whoever computes them."""

import concurrent.futures
import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time

import pytest

import fuyu

CAMPAIGN = """
scenario: package://fuyu/config/positioning.yaml
runs: 40
seed: 3
duration: 0.5
dispersions:
  controller.k_p: {apply: scale, normal: {mean: 1.0, sigma: 0.05}}
  'dynamics.initial_joint_positions[2]': {apply: add, uniform: {min: -0.05, max: 0.05}}
keep:
  results: [tip_position_error, final.q.joint1]
success:
  - tip_position_error < 2.0
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(CAMPAIGN)
    return path


def dataset(folder):
    """The bytes of all tables of results."""
    return {part.name: part.read_bytes() for part in (folder / "results").glob("*")}


def test_a_campaign_is_that_of_the_command_line(command, file, tmp_path):
    ran = [command, "campaign", "run", str(file), "--output", str(tmp_path / "cli"), "--json"]
    ran = subprocess.run(ran, capture_output=True, text=True, check=True)
    calls = []
    campaign = fuyu.Campaign(file)
    summary = campaign.run(tmp_path / "python", progress=lambda *call: calls.append(call))
    assert calls[0] == (0, 40) and calls[-1] == (40, 40)
    assert dataset(tmp_path / "python") == dataset(tmp_path / "cli") != {}
    expected = json.loads(ran.stdout)
    for one in (summary, expected):
        del one["wall_time"]
    assert summary == expected
    table = campaign.table(tmp_path / "python").to_pydict()
    row = campaign.run_one(7)
    assert row.pop("wall_time") > 0
    assert row == {name: table[name][7] for name in row} and table["run"] == list(range(40))
    assert campaign.parameters_of(7) == {name: row[name] for name in campaign.parameters}
    assert (campaign.name, campaign.runs, campaign.seed) == ("small", 40, 3)
    assert campaign.parameters == ["controller.k_p", "dynamics.initial_joint_positions[2]"]
    assert campaign.results == ["tip_position_error", "final.q.joint1"]
    assert campaign.criteria == ["tip_position_error < 2.0"]
    (tmp_path / "run.yaml").write_text(campaign.scenario_text(7))
    again = fuyu.Scenario(tmp_path / "run.yaml").simulate(0.5)
    assert again["tip_position_error"] == row["tip_position_error"]
    pictures = campaign.plots(tmp_path / "python")
    assert pictures and all(p.stat().st_size > 1000 for p in pictures)


def test_any_executor_computes_the_same(file, tmp_path):
    campaign = fuyu.Campaign(file, runs=30)
    assert campaign.runs == 30 and repr(pickle.loads(pickle.dumps(campaign))) == repr(campaign)
    campaign.run(tmp_path / "alone", jobs=1)
    spawn = multiprocessing.get_context("spawn")
    for k, executor in enumerate(
        [concurrent.futures.ThreadPoolExecutor(3), concurrent.futures.ProcessPoolExecutor(2, mp_context=spawn)]
    ):
        calls = []
        with executor:
            campaign.run(tmp_path / str(k), executor=executor, chunk=7, progress=lambda *call: calls.append(call))
        assert calls[-1] == (30, 30) and len(calls) == 5
        assert dataset(tmp_path / str(k)) == dataset(tmp_path / "alone") != {}


def test_an_exception_ends_a_campaign_which_continues(file, tmp_path):
    campaign = fuyu.Campaign(file)

    def stop(done, total):
        if done >= 5:
            raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        campaign.run(tmp_path / "cut", progress=stop)
    assert 5 <= campaign.summary(tmp_path / "cut")["completed"] < 40
    with pytest.raises(fuyu.RunError, match="has no complete table yet"):
        campaign.table(tmp_path / "cut")
    assert campaign.run(tmp_path / "cut")["completed"] == 40
    campaign.run(tmp_path / "whole")
    assert dataset(tmp_path / "cut") == dataset(tmp_path / "whole")


def test_ctrl_c_ends_a_campaign(file, tmp_path):
    program = f"import fuyu; fuyu.Campaign({str(file)!r}, runs=100000).run({str(tmp_path / 'cut')!r}, jobs=2)"
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=tmp_path,
        # What a shell starts in the background ignores it, and so would everything below.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while process.poll() is None and not any((tmp_path / "cut" / "journal").glob("*")):
        time.sleep(0.05)
    # As a terminal does: to all processes of the group.
    os.killpg(process.pid, signal.SIGINT)
    assert "KeyboardInterrupt" in process.communicate(timeout=60)[1]
    summary = fuyu.Campaign(file).summary(tmp_path / "cut")
    assert set(name for name, count in summary["verdicts"].items() if count) <= {"success"}


# One run takes minutes: nobody waits for it.
def test_ctrl_c_ends_a_campaign_during_its_runs(tmp_path):
    (tmp_path / "long.yaml").write_text(CAMPAIGN.replace("duration: 0.5", "duration: 1.0e+6"))
    program = "import fuyu; fuyu.Campaign('long.yaml').run('cut', jobs=2)"
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        while process.poll() is None and not any((tmp_path / "cut" / "journal").glob("*")):
            time.sleep(0.05)
        # Until its workers compute.
        time.sleep(2)
        process.send_signal(signal.SIGINT)
        assert "KeyboardInterrupt" in process.communicate(timeout=30)[1]
    finally:
        # Its workers end with it.
        process.kill()
        process.wait()
    assert fuyu.Campaign(tmp_path / "long.yaml").summary(tmp_path / "cut")["completed"] == 0


def test_a_process_that_cannot_start_ends_the_campaign(file, tmp_path, monkeypatch):
    campaign = fuyu.Campaign(file)
    with monkeypatch.context() as patch:
        patch.setattr("fuyu.campaign._WORKER", [sys.executable, "-m", "fuyu.no_such_module"])
        with pytest.raises(fuyu.RunError, match="ended before it was ready: exit status: 1"):
            campaign.run(tmp_path / "out")
    assert campaign.summary(tmp_path / "out")["completed"] == 0
    assert campaign.run(tmp_path / "out")["completed"] == 40


def test_wrong_campaigns_are_refused(file, tmp_path):
    campaign = fuyu.Campaign(file)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.pdf").write_text("")
    (tmp_path / "typo.yaml").write_text(CAMPAIGN.replace("controller.k_p:", "controller.k_q:"))
    for call, text in [
        (lambda: fuyu.Campaign("nowhere.yaml"), "nowhere.yaml: no such file"),
        (lambda: fuyu.Campaign(tmp_path / "typo.yaml"), "controller.k_q.*did you mean"),
        (lambda: campaign.parameters_of(40), "run 40: the campaign has runs 0 to 39"),
        (lambda: campaign.run_one(-1), "run -1: the campaign has runs 0 to 39"),
        (lambda: campaign.run_range(tmp_path / "x", 9, 8), "runs 9 to 8: the campaign has runs 0 to 39"),
        (lambda: campaign.run(tmp_path / "full"), "is not empty and holds no campaign"),
        (lambda: campaign.run(tmp_path / "x", jobs=0), "jobs is 0; it must be positive"),
        (lambda: campaign.summary(tmp_path), "is no folder of a campaign"),
        (lambda: campaign.summary(tmp_path, confidence=1), "confidence is 1; it must be between 0 and 1"),
        (lambda: campaign.run(tmp_path / "x", chunk=3), "chunk: only an executor gets tasks"),
        (
            lambda: campaign.run(tmp_path / "x", executor=concurrent.futures.ThreadPoolExecutor(1), chunk=0),
            "chunk is 0; it must be positive",
        ),
    ]:
        with pytest.raises(fuyu.InputError, match=text):
            call()
