"""Experiments that repeat claims of papers: training, trials on a farm of their own, verdicts; see ``trifarm experiment``."""
