"""The environment of a jailed child: nothing of its parent's but where libraries are; above all no token."""

import os
from pathlib import Path

import jail

SILENT = {"ORT_DISABLE_TELEMETRY": "1"}
"""onnxruntime 1.29 and later starts a thread on import that reports to its makers, unless the environment says no."""
_KEPT = ("LD_LIBRARY_PATH",)
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def jail_environment() -> dict[str, str]:
    """The whole environment of a child that is to enter a jail.

    A thread that reports to the makers of onnxruntime would also keep it from being jailed.
    """
    kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
    root = str(Path(jail.__file__).parent.parent)
    own = {"PYTHONPATH": root, "PYTHONDONTWRITEBYTECODE": "1"} | SILENT
    return kept | dict.fromkeys(_ONE_THREAD, "1") | own
