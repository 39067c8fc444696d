"""Computes a campaign with the workers of a Dask scheduler.

    python3 -m fuyu.campaign_dask ADDRESS DIR --campaign CONFIG --runs N [--chunk C] [--fuyu EXECUTABLE]

``fuyu campaign run --engine dask`` calls it. Each task is ``fuyu campaign run-range`` for some runs, which continues what an
earlier process for the same runs has left: a lost worker costs only the runs that it was computing. Scheduler and workers must
see the folder DIR and the executable under the same names; the workers need no other part of this package.
"""

import argparse
import subprocess
import sys


def run_range(fuyu, campaign, folder, runs, first, last):
    """Computes the runs ``first`` to ``last`` of ``runs`` on the worker; returns how many these are, and what is wrong with the
    input, or None.

    Raises RuntimeError with the last line that ``fuyu`` wrote to stderr if it failed otherwise, which may be tried again.
    """
    command = [fuyu, "campaign", "run-range", campaign, "--output", folder]
    command += ["--runs", str(runs), "--first", str(first), "--last", str(last)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"{fuyu} ended with {done.returncode}"]
        problem = f"runs {first} to {last}: {lines[-1]}"
        if done.returncode == 2:
            return 0, problem
        raise RuntimeError(problem)
    return last - first + 1, None


def ranges(runs, size):
    """First and last run of each task."""
    return [(first, min(first + size, runs) - 1) for first in range(0, runs, size)]


def main(arguments=None):
    """Runs the command; returns its exit code: 0 done, 1 a task failed, 2 wrong input."""
    parser = argparse.ArgumentParser(prog="fuyu.campaign_dask", description="Computes a campaign with Dask.")
    parser.add_argument("address", help="of the scheduler, such as tcp://127.0.0.1:8786")
    parser.add_argument("folder", help="of the campaign")
    parser.add_argument("--campaign", required=True, help="the campaign's file")
    parser.add_argument("--runs", required=True, type=int, help="number of runs")
    parser.add_argument("--chunk", type=int, default=256, help="runs per table of the dataset")
    parser.add_argument("--fuyu", default="fuyu", help="the executable, on the workers")
    options = parser.parse_args(arguments)

    from distributed import Client, as_completed

    try:
        client = Client(options.address, timeout=10)
    except (OSError, ValueError) as error:
        print(f"fuyu: error: {options.address}: no Dask scheduler answers: {error}", file=sys.stderr)
        return 2
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            print(f"fuyu: error: {options.address}: the scheduler has no workers", file=sys.stderr)
            return 2
        # Several tasks per thread, so that all end at about the same time.
        size = max(1, min(options.chunk, -(-options.runs // (4 * threads))))
        tasks = [
            client.submit(
                run_range,
                options.fuyu,
                options.campaign,
                options.folder,
                options.runs,
                first,
                last,
                pure=False,
                retries=3,
            )
            for first, last in ranges(options.runs, size)
        ]
        done = 0
        for task in as_completed(tasks):
            try:
                count, problem = task.result()
                if problem is not None:
                    print(f"fuyu: error: {problem}", file=sys.stderr)
                    client.cancel(tasks)
                    return 2
                done += count
            except Exception as error:  # whatever the task or its worker ended with
                print(f"fuyu: error: {error}", file=sys.stderr)
                client.cancel(tasks)
                return 1
            print(f"fuyu: {done} of {options.runs} runs", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
