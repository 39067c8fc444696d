"""The notebook and the examples run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_the_notebook_runs(tmp_path):
    pytest.importorskip("matplotlib")
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(EXAMPLES / "tour.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "commit the notebook without outputs"
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    text = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", []))
    assert "transpose_jacobian" in text and "single_axis" in text


# Fails if rewards, observations or actions have the wrong sign or frame.
def test_a_policy_learns_to_reach():
    sys.path.insert(0, str(EXAMPLES))
    try:
        from train_reach_numpy import Search
    finally:
        sys.path.pop(0)
    search = Search(directions=16, robots_each=4, episode_steps=60)
    before, _ = search.evaluate(64)
    for _ in range(16):
        search.improve()
    after, _ = search.evaluate(64)
    # From 1.07 m; it is 0.95 m after 8 updates and 0.78 m after 16.
    assert after < 0.9 * before, (before, after)


def test_the_examples_say_what_they_do():
    ran = subprocess.run(
        [sys.executable, EXAMPLES / "train_reach_numpy.py", "--help"], capture_output=True, text=True, env=os.environ
    )
    # Lines are broken at the width of the terminal.
    assert ran.returncode == 0 and "augmented random search" in " ".join(ran.stdout.split())
