"""What holds for all tests: one thread each, signals mean what they mean at a terminal, and onnxruntime reports to nobody."""

import os
import signal

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # read when numpy is first imported, which the next line does
    os.environ.setdefault(name, "1")

from tests.homes import postgres, s3  # noqa: E402, F401  fixtures of the whole run


def pytest_configure() -> None:
    """A shell's background job and nohup ignore signals, and every process started here would inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
