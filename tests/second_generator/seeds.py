"""Seeds and counts: development seeds are free to use, final seeds are sealed until the final run."""

import numpy as np

KINDS = ("single", "double", "outside", "healthy")
DEVELOPMENT_SEEDS = (11, 12, 13, 14, 15, 21, 22)
FINAL_COUNTS = {"single": 120, "double": 40, "outside": 40, "healthy": 60}
FINAL_SEEDS = (763475, 695974, 657713, 477023, 406184, 676660)
"""Drawn by ``secrets``, three on 2026-11-24, before any case was shown to the tool, and three on 2026-11-29, when those had been
judged. A run that counts takes the first; each later run takes the next, and all runs are kept. A run on the second one was begun
on 2026-11-28 with commit 272ffa2e and deleted after 55 of 260 answers, before anybody had seen a case, an answer or a score. The
one that counts was made with commit 368cc9fd in several sittings, and opened on 2026-11-29. On that day the one on the third seed
was made with commit 2515a12f, and opened.
"""


def case_rng(seed, kind, index):
    """The generator of one case, which depends on nothing but these three."""
    return np.random.default_rng([seed, KINDS.index(kind), index])
