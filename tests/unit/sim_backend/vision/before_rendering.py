"""Loaded before anything is rendered: MuJoCo's renderer in software and torch's compiler each bring an LLVM of their own.

A process that first renders and then loads torch's crashes; the other way round both work.
"""

import importlib
import importlib.util

if importlib.util.find_spec("triton") is not None:
    importlib.import_module("triton.knobs")
