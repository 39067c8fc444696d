#!/usr/bin/env python3
"""Checks that a campaign is the same whoever computes it and whatever is killed meanwhile, and prints times and statistics.

1. `fuyu campaign run` on all processors;
2. the same by two workers of a Dask scheduler, one of which is killed (SIGKILL) and replaced by none;
3. the same on all processors, killed again and again, and continued;
4. some runs, chosen at random, printed by `fuyu campaign show` and simulated alone.

The files of the results of 1, 2 and 3 must have the same bytes, and the values of 4 those of their rows.

    pip install ./python pyarrow distributed
    python scripts/check-campaign.py --fuyu target/release/fuyu --runs 10000 --folder /tmp/check
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

#: Longest wait for a scheduler or for the first rows [s].
PATIENCE = 60.0


class Check:
    """A campaign and the executable that computes it."""

    def __init__(self, fuyu: str, config: str, runs: int, folder: Path) -> None:
        self.fuyu, self.config, self.runs, self.folder = fuyu, config, runs, folder
        # The engine `dask` calls python3, which must be this one.
        self.environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}

    def command(self, name: str, *more: str) -> list[str]:
        """`fuyu campaign run` into the folder `name`."""
        run = [self.fuyu, "campaign", "run", self.config, "--output", str(self.folder / name)]
        return [*run, "--runs", str(self.runs), "--json", *more]

    def complete(self, name: str, *more: str) -> tuple[dict, float]:
        """Runs to the end; returns the summary and the time that it took [s]."""
        start = time.perf_counter()
        done = subprocess.run(self.command(name, *more), capture_output=True, text=True, env=self.environment)
        if done.returncode != 0:
            raise SystemExit(f"{name}: {done.stderr.strip()}")
        return json.loads(done.stdout), time.perf_counter() - start

    def rows(self, name: str) -> int:
        """Rows in complete tables and in journals."""
        folder = self.folder / name
        summary = [self.fuyu, "campaign", "summary", str(folder), "--json"]
        done = subprocess.run(summary, capture_output=True, text=True)
        return json.loads(done.stdout)["completed"] if done.returncode == 0 else 0

    def bytes(self, name: str) -> dict[str, bytes]:
        """The files of the results."""
        return {file.name: file.read_bytes() for file in (self.folder / name / "results").iterdir()}

    def dask(self, name: str) -> tuple[float, int]:
        """Computes with two worker processes and kills one at a third of the runs; returns the time [s] and the rows then."""
        with scheduler(self.environment) as (address, workers):
            start = time.perf_counter()
            run = subprocess.Popen(
                self.command(name, "--engine", "dask", "--address", address),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                env=self.environment,
            )
            while run.poll() is None and (done := self.rows(name)) < self.runs / 3:
                time.sleep(0.05)
            if run.poll() is not None:
                raise SystemExit(f"dask: ended before a worker was killed: {run.stderr.read()}")
            # The worker and the runs that it computes.
            os.killpg(workers[0].pid, signal.SIGKILL)
            errors = run.communicate()[1]
            if run.returncode != 0:
                raise SystemExit(f"dask: {errors}")
            return time.perf_counter() - start, done

    def killed(self, name: str, kills: int, seconds: float) -> list[int]:
        """Kills the campaign `kills` times, at random times that together are its own; returns the rows after each."""
        rows = []
        for _ in range(kills):
            with open(os.devnull, "w") as null:
                run = subprocess.Popen(self.command(name), stdout=null, stderr=null, start_new_session=True)
            time.sleep(random.uniform(0.3, 1.7) * seconds / (kills + 1))
            # Some of the kills leave the workers to notice it, some end everything.
            (run.kill if random.random() < 0.5 else lambda: os.killpg(run.pid, signal.SIGKILL))()
            run.wait()
            rows.append(self.rows(name))
        return rows

    def repeat(self, name: str, count: int) -> int:
        """Simulates some runs alone and compares all numbers of the rows; returns how many there were."""
        import pyarrow as pa
        import pyarrow.parquet as parquet

        parts = sorted((self.folder / name / "results").iterdir())
        table = pa.concat_tables(parquet.ParquetFile(part).read() for part in parts)
        kept = json.loads((self.folder / name / "campaign.json").read_text())
        compared = 0
        for run in random.sample(range(self.runs), count):
            show = [self.fuyu, "campaign", "show", str(self.folder / name), "--run", str(run)]
            scenario = self.folder / f"run-{run}.yaml"
            scenario.write_text(subprocess.run(show, capture_output=True, text=True, check=True).stdout)
            simulate = [self.fuyu, "simulate", str(scenario), "--json"]
            result = json.loads(subprocess.run(simulate, capture_output=True, text=True, check=True).stdout)
            row = table.slice(run, 1).to_pylist()[0]
            if row["run"] != run:
                raise SystemExit(f"row {run} of the dataset is run {row['run']}")
            for column in results_of(kept):
                alone, own = value(result, column), row[column]
                if alone != own:
                    raise SystemExit(f"run {run}: {column} is {own!r} in the campaign, {alone!r} alone")
                compared += 1
        return compared


def results_of(manifest: dict) -> list[str]:
    """Names of the kept results."""
    return [column["name"] if isinstance(column, dict) else column for column in manifest["results"]]


def value(result: dict, name: str):
    """A value of `fuyu simulate --json` by its dotted name."""
    found = result
    for part in name.replace("[", ".").replace("]", "").split("."):
        found = found[int(part)] if isinstance(found, list) else found[part]
    return found


@contextlib.contextmanager
def scheduler(environment: dict[str, str]) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """A Dask scheduler at a free port with two workers of one thread, each in a session of its own."""
    with tempfile.TemporaryDirectory() as folder:
        file, processes = Path(folder) / "scheduler.json", []

        def start(*command: str) -> subprocess.Popen:
            quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            call = [sys.executable, "-m", *command]
            process = subprocess.Popen(call, start_new_session=True, cwd=folder, env=environment, **quiet)
            processes.append(process)
            return process

        try:
            start(
                "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                "--scheduler-file", str(file),
            )  # fmt: skip
            wait_for(file.exists, "a scheduler")
            options = ["--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard"]
            workers = [start("distributed.cli.dask_worker", *options) for _ in range(2)]
            address = json.loads(file.read_text())["address"]
            from distributed import Client

            with Client(address) as client:
                client.wait_for_workers(2, timeout=PATIENCE)
            yield address, workers
        finally:
            for process in processes:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def wait_for(condition, what: str) -> None:
    """Waits until `condition()`."""
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise SystemExit(f"{what} did not start within {PATIENCE:.0f} s")
        time.sleep(0.05)


def main() -> None:
    root = Path(__file__).resolve().parents[1]
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--fuyu", default=str(root / "target/release/fuyu"), help="the executable")
    options.add_argument("--config", default=str(root / "config/campaigns/positioning.yaml"), help="the campaign")
    options.add_argument("--runs", type=int, default=10_000)
    options.add_argument("--kills", type=int, default=10, help="of the campaign that is continued")
    options.add_argument("--repeat", type=int, default=10, help="runs to simulate alone")
    options.add_argument("--seed", type=int, default=1, help="of the choice of runs and of times of kills")
    options.add_argument("--folder", type=Path, help="a new folder for the campaigns; default: one that is removed at the end")
    given = options.parse_args()
    random.seed(given.seed)
    with contextlib.ExitStack() as stack:
        folder = given.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        check = Check(os.path.abspath(given.fuyu), os.path.abspath(given.config), given.runs, folder)
        summary, seconds = check.complete("local")
        rate = summary["success_rate"]
        print(f"local: {given.runs} runs in {seconds:.1f} s, {given.runs / seconds:.1f} per second")
        print(f"success: {json.dumps(rate)}; verdicts {json.dumps(summary.get('verdicts'))}", flush=True)
        expected = check.bytes("local")
        seconds_dask, rows = check.dask("dask")
        if check.bytes("dask") != expected:
            raise SystemExit("dask: the results differ")
        print(f"dask: one of two workers killed after {rows} rows, {seconds_dask:.1f} s: same bytes", flush=True)
        rows_after = check.killed("killed", given.kills, seconds)
        check.complete("killed")
        if check.bytes("killed") != expected:
            raise SystemExit("killed: the results differ")
        print(f"killed {given.kills} times, with rows {rows_after}: same bytes", flush=True)
        compared = check.repeat("local", given.repeat)
        print(f"{given.repeat} runs alone: {compared} numbers, all equal")


if __name__ == "__main__":
    main()
