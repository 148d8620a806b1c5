"""Ten trials of a policy, how far from its goal the object was in each of them, and a signed report.

Needs a farm: ``trifarm up`` in another terminal, or TRIFARM_URL and TRIFARM_TOKEN of one elsewhere.
"""

import sys

import numpy as np

from trifarm import Farm

if len(sys.argv) < 2:
    sys.exit("usage: python first_job.py WEIGHTS [TRIALS]")
weights, trials = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10
with Farm() as farm:
    job = farm.submit(weights, task="push", trials=trials, seed=1)
    report = job.wait()
    print(f"{report.successes} of {report.trials} succeeded, 95 % interval {report.interval_95}")
    for each in job.trials():
        log = each.log()
        away_mm = 1e3 * np.linalg.norm(log.tracked_position_world_m - log.goal[0], axis=1)
        print(f"trial {each.trial.ordinal} on {each.trial.robot}: {away_mm[0]:.0f} mm away at first, {away_mm[-1]:.0f} at last")
    job.save_report("report.html")
