"""Experiments of papers, tried on our robots: trains or loads, submits to a farm of its own, judges; ``trifarm experiment``."""
