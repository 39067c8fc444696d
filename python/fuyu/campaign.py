"""Campaigns: a scenario many times, with parameters that differ from run to run."""

from __future__ import annotations

import concurrent.futures
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._fuyu import CampaignFile, InputError, RunError, campaign_plots, campaign_summary

if TYPE_CHECKING:
    import pyarrow

_WORKER = [sys.executable, "-m", "fuyu.campaign_worker"]


class Campaign:
    """A campaign: its file, such as `config/campaigns/positioning.yaml` (docs/campaigns.md), ready to run.

    `runs` replaces the file's number of runs. A run is determined by the campaign's seed and its number, whoever computes it. Campaigns
    go to other processes by pickle, as path and number of runs.
    """

    def __init__(self, source: str | os.PathLike[str], runs: int | None = None) -> None:
        self._source = os.fspath(source)
        self._file = CampaignFile(self._source, runs)

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self._file.name

    @property
    def path(self) -> str:
        """The file; `package://fuyu/PATH` if it comes with the package."""
        return self._file.path

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self._file.runs

    @property
    def seed(self) -> int:
        """The campaign's seed."""
        return self._file.seed

    @property
    def parameters(self) -> list[str]:
        """Names of the dispersed parameters; `NAME[0]`, ... for the elements of a list."""
        return self._file.parameters

    @property
    def results(self) -> list[str]:
        """Names of the kept results."""
        return self._file.results

    @property
    def criteria(self) -> list[str]:
        """The criteria of success."""
        return self._file.criteria

    def parameters_of(self, run: int) -> dict[str, Any]:
        """The dispersed parameters of a run, by name."""
        return self._file.parameters_of(run)

    def scenario_text(self, run: int) -> str:
        """The scenario of a run as a parameter file, which `fuyu simulate` repeats to the bit."""
        return self._file.scenario_text(run)

    def run_one(self, run: int) -> dict[str, Any]:
        """Computes one run without a folder: its row of the dataset, with its `wall_time` [s]. The interpreter's lock is released."""
        return self._file.run_one(run)

    def run_range(self, folder: str | os.PathLike[str], first: int, last: int, *, jobs: int = 1) -> int:
        """Computes the runs `first` to `last` that `folder` lacks, `jobs` at a time; returns how many of them are done.

        For schedulers of other machines: any number of processes may fill the same folder at the same time. A range whose process was
        killed is repeated, and continues.
        """
        return self._file.run_range(folder, first, last, jobs=jobs, command=_WORKER)

    def run(
        self,
        folder: str | os.PathLike[str],
        *,
        jobs: int | None = None,
        executor: concurrent.futures.Executor | None = None,
        chunk: int | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> dict[str, Any]:
        """Computes the runs that `folder` lacks, and returns the summary.

        By default `jobs` processes of this machine compute, as many as it has processors. With an `executor`, such as those of
        `concurrent.futures`, Dask (`client.get_executor()`), mpi4py or Parsl, tasks of `chunk` runs are submitted to it; its workers
        must see the folder and the campaign's file under the same paths. `progress(done, total)` is called now and then.
        After an exception, Ctrl-C or a kill, the same call continues. `RunError` is raised if a process cannot start.
        """
        folder = os.path.abspath(folder)
        if executor is None:
            if chunk is not None:
                raise InputError("chunk: only an executor gets tasks")
            jobs = jobs if jobs is not None else len(os.sched_getaffinity(0))
            if jobs < 1:
                raise InputError(f"jobs is {jobs}; it must be positive")
            self._file.run_range(folder, 0, self.runs - 1, jobs=jobs, command=_WORKER, progress=progress)
            return self.summary(folder)
        if jobs is not None:
            raise InputError("jobs: the executor determines how many runs are computed at the same time")
        size = 64 if chunk is None else chunk
        if size < 1:
            raise InputError(f"chunk is {size}; it must be positive")
        # Wrong folders are refused here.
        self._file.create(folder)
        firsts = range(0, self.runs, size)
        tasks = [executor.submit(_compute, self, folder, k, min(k + size, self.runs) - 1) for k in firsts]
        done = 0
        try:
            for task in concurrent.futures.as_completed(tasks):
                done += task.result()
                if progress is not None:
                    progress(done, self.runs)
        except BaseException:
            for task in tasks:
                task.cancel()
            raise
        return self.summary(folder)

    def summary(self, folder: str | os.PathLike[str], *, confidence: float = 0.95) -> dict[str, Any]:
        """Statistics of the runs that are done: the object of `fuyu campaign summary --json`."""
        return json.loads(campaign_summary(folder, confidence))

    def table(self, folder: str | os.PathLike[str]) -> pyarrow.Table:
        """The rows that are in complete tables, by ascending run: run, seed, verdict, reason, parameters, results, version."""
        import pyarrow as pa
        import pyarrow.parquet

        parts = sorted((Path(folder) / "results").glob("part-*.parquet"))
        if not parts:
            raise RunError(f"{folder}: has no complete table yet")
        return pa.concat_tables(pyarrow.parquet.read_table(part, memory_map=False) for part in parts)

    def plots(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Draws pictures into `folder`/plots: cumulative distributions and scatter plots."""
        return [Path(picture) for picture in campaign_plots(folder)]

    def __reduce__(self) -> tuple[Any, ...]:
        return Campaign, (os.path.abspath(self._source) if os.path.exists(self._source) else self._source, self.runs)

    def __repr__(self) -> str:
        return f"fuyu.Campaign({self._source!r}, runs={self.runs})"


def _compute(campaign: Campaign, folder: str, first: int, last: int) -> int:
    """A task of an executor."""
    return campaign.run_range(folder, first, last)
