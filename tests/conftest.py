"""What holds for all tests: one thread each, signals mean what they mean at a terminal, and onnxruntime reports to nobody."""

import gc
import json
import os
import signal
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # read when numpy is first imported, which the next line does
    os.environ.setdefault(name, "1")

import httpx  # noqa: E402
import pytest  # noqa: E402

from tests import ROOT  # noqa: E402
from tests.homes import postgres, s3  # noqa: E402, F401  fixtures of the whole run
from tests.integration.farm_process import PATIENCE_S  # noqa: E402


def pytest_configure() -> None:
    """A shell's background job and nohup ignore signals, and every process started here would inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    for wait in ("connect", "read", "write", "pool"):  # else 5 s, which a machine that stalls takes
        setattr(httpx._config.DEFAULT_TIMEOUT_CONFIG, wait, PATIENCE_S)
    gc.disable()  # what is imported stays: looking through it again and again is a fifth of the collection


def pytest_collection_finish() -> None:
    """From here on garbage is collected; what all tests share is not looked at again."""
    gc.freeze()
    gc.enable()


_CORES = os.sched_getaffinity(0)


def pytest_runtest_logfinish() -> None:
    """A robot stays on one core, also one that a test made in this process; the next test has all of them again."""
    if os.sched_getaffinity(0) != _CORES:
        os.sched_setaffinity(0, _CORES)


_COMPUTE = ("architecture", "identification", "unit")


def _seconds_of_files() -> dict[Path, float]:
    """What files took, as far as it is known of them: the tests of two seconds and more."""
    took_s: dict[Path, float] = {}
    for test in json.loads((ROOT / "results/suite-times.json").read_text())["tests"]:
        path = ROOT / (test["test"].partition("::")[0].replace(".", "/") + ".py")
        took_s[path] = took_s.get(path, 0.0) + test["s"]
    return took_s


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that compute take turns with those that wait for farms and browsers, so that cores have always something to do.

    Of each kind those come first that took longest when times were last kept, so that no core waits for a long one at the end.
    """
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    kinds: dict[bool, list[Path]] = {True: [], False: []}
    took_s = _seconds_of_files()
    for path in sorted(files, key=lambda path: -took_s.get(path, 0.0)):
        kinds[path.relative_to(ROOT / "tests").parts[0] in _COMPUTE].append(path)
    placed = [(place / len(paths), path) for paths in kinds.values() for place, path in enumerate(paths)]
    items[:] = [item for _, path in sorted(placed, key=lambda each: each[0]) for item in files[path]]
