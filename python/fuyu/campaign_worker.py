"""A process that computes runs of a campaign for another one: `python3 -m fuyu.campaign_worker DIR`."""

import signal
import sys

from ._fuyu import campaign_worker

if __name__ == "__main__":
    # Ctrl-C is for the process that wants the runs; this one ends with its stdin.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    campaign_worker(sys.argv[1])
