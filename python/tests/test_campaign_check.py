"""The same campaign by Dask with a killed worker, killed and continued, and run by run: scripts/check-campaign.py, small."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from test_campaign import CAMPAIGN


def test_nobody_changes_a_campaign(command, tmp_path):
    pytest.importorskip("distributed")
    pytest.importorskip("pyarrow")
    file = tmp_path / "small.yaml"
    # Runs that take long enough to be killed.
    file.write_text(CAMPAIGN.replace("duration: 0.5", "duration: 20.0"))
    check = [sys.executable, str(ROOT / "scripts/check-campaign.py"), "--fuyu", command, "--config", str(file)]
    check += ["--runs", "60", "--kills", "1", "--repeat", "3", "--folder", str(tmp_path / "check")]
    done = subprocess.run(check, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    local, success, dask, killed, alone = done.stdout.splitlines()
    assert local.startswith("local: 60 runs") and success.startswith("success")
    assert dask.startswith("dask: one of two workers killed after ") and dask.endswith("same bytes")
    assert killed.startswith("killed 1 times") and killed.endswith("same bytes")
    assert alone == "3 runs alone: 6 numbers, all equal"


def test_a_scheduler_without_workers_is_refused(command, tmp_path):
    distributed = pytest.importorskip("distributed")
    file = tmp_path / "small.yaml"
    file.write_text(CAMPAIGN)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    with distributed.LocalCluster(n_workers=0, processes=True, dashboard_address=None) as cluster:
        run = [command, "campaign", "run", str(file), "--output", str(tmp_path / "out"), "--engine", "dask"]
        run += ["--address", cluster.scheduler_address]
        done = subprocess.run(run, capture_output=True, text=True, timeout=60, env=os.environ | {"PATH": path})
    assert done.returncode == 2, done.stderr
    assert "the scheduler has no workers" in done.stderr
