"""The child process that converts a policy: ``python -m services.policies.conversion WEIGHTS MANIFEST OUT.onnx LEVEL``.

``OUT.onnx`` lies in the working folder, the only one that it sees from its jail; it refuses a jail below ``LEVEL``. It prints one
line of JSON when the graph is written and one more after the dry run. The kernel ends it when it computes for too long; the
parent then goes by the lines that it has.
"""

import json
import os
import signal
import sys
from pathlib import Path

from api_schemas.jail.entering import enter
from api_schemas.jail.level import JailLevel, too_open
from api_schemas.jail.needs import Needs
from api_schemas.policy import MAX_WEIGHTS_BYTES

CPU_LIMIT_S = 5
MEMORY_LIMIT_BYTES = 1024**3
FILE_LIMIT_BYTES = 512 * 1024**2
DRY_RUN_CPU_S = 2.0
ARCHIVE_LIMIT_BYTES = MAX_WEIGHTS_BYTES


def confine(least: JailLevel) -> str | None:
    """Limits this process and closes its jail before it parses anything that a user sent.

    Returns:
        Why this jail is not closed enough, None if it is.
    """
    # What is still held open from the parent beyond the standard three is none of the child's business.
    os.closerange(3, 1024)
    folder = Path.cwd()
    needs = Needs(MEMORY_LIMIT_BYTES, CPU_LIMIT_S, FILE_LIMIT_BYTES, installation=True, folder=folder)
    return too_open(enter(needs), least)


def convert(weights: bytes, kind: str, manifest_text: str, out: Path) -> None:
    """Writes the graph; prints what became of it.

    Args:
        weights: the content of the file.
        kind: the end of its name, with the dot.
        manifest_text: as JSON.
        out: the file to write.

    Raises:
        UnfitError: weights and manifest do not make a policy.
    """
    # Imported under the limits, because the parsers are what the limits are for.
    import safetensors.numpy

    from api_schemas.policy import PolicyManifest
    from services.policies import dry_run, graph, sb3_network, uploaded

    manifest = PolicyManifest.model_validate_json(manifest_text)
    if kind == ".onnx":
        model = graph.around(uploaded.parse(weights, manifest), manifest)
    elif kind == ".zip":
        # What lies within an archive that was deflated is checked here for the first time, against the file's own size at least.
        limit_bytes = max(len(weights), ARCHIVE_LIMIT_BYTES)
        model = graph.around(sb3_network.read_archive(memoryview(weights), limit_bytes, manifest), manifest)
    else:
        model = graph.from_tensors(safetensors.numpy.load(weights), manifest)
    out.write_bytes(model.SerializeToString())
    session = dry_run.load(out)
    _say(converted=True)
    # The default action of this signal ends the process: also from inside a native loop that never comes back to Python.
    signal.setitimer(signal.ITIMER_PROF, DRY_RUN_CPU_S)
    warnings = dry_run.run(session, manifest)
    signal.setitimer(signal.ITIMER_PROF, 0)
    _say(warnings=warnings)


def main() -> None:
    """Converts as the command line says; every refusal is a line, every other failure an exit status."""
    weights, manifest, out = (Path(argument) for argument in sys.argv[1:4])
    content, manifest_text = weights.read_bytes(), manifest.read_text()
    if (reason := confine(JailLevel(sys.argv[4]))) is not None:
        _say(too_open=reason)
        return
    from services.policies.unfit import UnfitError

    try:
        convert(content, weights.suffix, manifest_text, out)
    except UnfitError as error:
        _say(problem={"why": error.why, "part": error.part, "instead": error.instead, "slug": error.slug, "pack": error.pack})
    except (ImportError, PermissionError) as error:  # the jail is too narrow for the farm's own code
        _say(broken=f"{type(error).__name__}: {error}"[:1000])
    except MemoryError:
        _say(problem={"why": f"the conversion needs more than {MEMORY_LIMIT_BYTES} bytes of memory"})
    except Exception as error:  # a parser's own error is the user's answer, shortened
        _say(problem={"why": f"it cannot be converted: {type(error).__name__}: {error}"[:1000]})


def _say(**line: object) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
