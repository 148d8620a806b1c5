"""The back ends that tests run on: MuJoCo's, and mujoco_warp on the processor where the extra 'gpu' is installed."""

import importlib.util

import pytest

REASON = "the extra 'gpu' (mujoco_warp) is not installed"
WARP_IS_MISSING = importlib.util.find_spec("mujoco_warp") is None
needs_warp = pytest.mark.skipif(WARP_IS_MISSING, reason=REASON)
BACKENDS = ["cpu", pytest.param("warp-cpu", marks=needs_warp)]
