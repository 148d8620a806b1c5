"""The child process that converts a policy: ``python -m services.policies.conversion WEIGHTS MANIFEST OUT.onnx``.

It prints one line of JSON when the graph is written and one more after the smoke run. The kernel ends it when it computes
for too long; the parent then goes by the lines that it has.
"""

import json
import os
import resource
import signal
import sys
from pathlib import Path

from api_schemas.policy import MAX_WEIGHTS_BYTES

CPU_LIMIT_S = 5
MEMORY_LIMIT_BYTES = 1024**3
FILE_LIMIT_BYTES = 512 * 1024**2
SMOKE_CPU_S = 2.0
ARCHIVE_LIMIT_BYTES = MAX_WEIGHTS_BYTES


def confine() -> None:
    """Limits this process before it reads anything that a user sent."""
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT_S, CPU_LIMIT_S))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_LIMIT_BYTES, FILE_LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # What is still held open from the parent beyond the standard three is none of the child's business.
    os.closerange(3, 1024)


def convert(weights: Path, manifest_text: str, out: Path) -> None:
    """Writes the graph; prints what became of it.

    Raises:
        UnfitError: weights and manifest do not make a policy.
    """
    # Imported under the limits, because the parsers are what the limits are for.
    import safetensors.numpy

    from api_schemas.policy import PolicyManifest
    from services.policies import graph, sb3_network, smoke, uploaded

    manifest = PolicyManifest.model_validate_json(manifest_text)
    content = weights.read_bytes()
    if weights.suffix == ".onnx":
        model = graph.around(uploaded.parse(content, manifest), manifest)
    elif weights.suffix == ".zip":
        # What lies within an archive that was deflated is checked here for the first time, against the file's own size at least.
        limit_bytes = max(len(content), ARCHIVE_LIMIT_BYTES)
        model = graph.around(sb3_network.read_archive(memoryview(content), limit_bytes, manifest), manifest)
    else:
        model = graph.from_tensors(safetensors.numpy.load(content), manifest)
    out.write_bytes(model.SerializeToString())
    session = smoke.load(out)
    _say(converted=True)
    # The default action of this signal ends the process: also from inside a native loop that never comes back to Python.
    signal.setitimer(signal.ITIMER_PROF, SMOKE_CPU_S)
    warnings = smoke.run(session, manifest)
    signal.setitimer(signal.ITIMER_PROF, 0)
    _say(warnings=warnings)


def main() -> None:
    """Converts as the command line says; every refusal is a line, every other failure an exit status."""
    confine()
    weights, manifest, out = (Path(argument) for argument in sys.argv[1:4])
    from services.policies.unfit import UnfitError

    try:
        convert(weights, manifest.read_text(), out)
    except UnfitError as error:
        _say(problem={"why": error.why, "part": error.part, "instead": error.instead, "slug": error.slug, "pack": error.pack})
    except MemoryError:
        _say(problem={"why": f"the conversion needs more than {MEMORY_LIMIT_BYTES} bytes of memory"})
    except Exception as error:  # a parser's own error is the user's answer, shortened
        _say(problem={"why": f"it cannot be converted: {type(error).__name__}: {error}"[:1000]})


def _say(**line: object) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
