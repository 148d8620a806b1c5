"""The environment of a jailed child: nothing of its parent's but where libraries are; above all no token."""

import os
from pathlib import Path

import api_schemas
from api_schemas.runtime import SILENT

_KEPT = ("LD_LIBRARY_PATH",)
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def jail_environment() -> dict[str, str]:
    """The whole environment of a child that is to enter a jail.

    onnxruntime 1.29 and later would start a thread that sends what it runs to its makers, and could no longer be jailed.
    """
    kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
    root = str(Path(api_schemas.__file__).parent.parent)
    own = {"PYTHONPATH": root, "PYTHONDONTWRITEBYTECODE": "1"} | SILENT
    return kept | dict.fromkeys(_ONE_THREAD, "1") | own
