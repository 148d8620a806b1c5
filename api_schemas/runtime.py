"""onnxruntime as the farm uses it: one thread, and silent.

From version 1.29 on its wheels for Linux start a thread on import that reports to their makers, unless the environment says no.
Every process of the farm gets the runtime from here; a test looks for other imports.
"""

import os
from pathlib import Path
from typing import Any

SILENT = {"ORT_DISABLE_TELEMETRY": "1"}


def runtime() -> Any:
    """The module, imported when it is first asked for: some processes close their jail right after."""
    os.environ.update(SILENT)
    import onnxruntime

    onnxruntime.disable_telemetry_events()
    return onnxruntime


def session(graph: bytes | Path) -> Any:
    """A session of one thread on the CPU, as robots have it; ``graph`` is a model or its file.

    Raises:
        Exception: the runtime cannot load the graph; of which class is the runtime's own affair.
    """
    module = runtime()
    options = module.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = module.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4
    return module.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
