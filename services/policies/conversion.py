"""The child process that converts: ``python -m services.policies.conversion WEIGHTS MANIFEST OUT.onnx LEVEL [LIMIT]``.

``OUT.onnx`` lies in the working folder, the only one that it sees from its jail; it refuses a jail below ``LEVEL``, and a graph
of more than about twice ``LIMIT``, the most bytes that weights may have (64 MiB if it is not given). It prints one line of JSON
when the graph is written and one more after the dry run. The kernel ends it when it computes for too long; the parent then goes
by the lines that it has.
"""

import json
import os
import signal
import sys
from pathlib import Path

from api_schemas.policy import MAX_WEIGHTS_BYTES
from jail.entering import enter
from jail.level import JailLevel, too_open
from jail.needs import Needs

CPU_LIMIT_S = 5
MEMORY_LIMIT_BYTES = 1024**3
DRY_RUN_CPU_S = 2.0
GRAPH_TIMES = 2
"""How many times the limit of weights a graph may have: numbers of 16 bits become 32."""
SPARE_BYTES = 64 * 1024
"""For what a graph has beside its numbers."""


def graph_limit_bytes(limit_bytes: int) -> int:
    """The most that a graph may have where weights may have ``limit_bytes``."""
    return GRAPH_TIMES * limit_bytes + SPARE_BYTES


def confine(least: JailLevel, file_bytes: int) -> str | None:
    """Limits this process and closes its jail before it parses anything that a user sent; it writes no file over ``file_bytes``.

    Returns:
        Why this jail is not closed enough, None if it is.
    """
    # What is still held open from the parent beyond the standard three is none of the child's business.
    os.closerange(3, 1024)
    folder = Path.cwd()
    needs = Needs(MEMORY_LIMIT_BYTES, CPU_LIMIT_S, file_bytes, installation=True, folder=folder)
    return too_open(enter(needs), least)


def convert(weights: bytes, kind: str, manifest_text: str, out: Path, limit_bytes: int) -> None:
    """Writes the graph; prints what became of it.

    Args:
        weights: the content of the file.
        kind: the end of its name, with the dot.
        manifest_text: as JSON.
        out: the file to write.
        limit_bytes: the most that weights may have.

    Raises:
        UnfitError: weights and manifest do not make a policy, or one that is too large.
    """
    # Imported under the limits, because the parsers are what the limits are for.
    import safetensors.numpy

    from api_schemas.policy import PolicyManifest
    from services.policies import dry_run, graph, sb3_network, uploaded
    from services.policies.unfit import blind_format, graph_too_large

    manifest = PolicyManifest.model_validate_json(manifest_text)
    if manifest.images is not None and kind != ".onnx":
        raise blind_format(kind)
    if kind == ".onnx":
        model = graph.around(uploaded.parse(weights, manifest), manifest)
    elif kind == ".zip":
        model = graph.around(sb3_network.read_archive(memoryview(weights), limit_bytes, manifest), manifest)
    else:
        model = graph.from_tensors(safetensors.numpy.load(weights), manifest)
    if (size := model.ByteSize()) > graph_limit_bytes(limit_bytes):
        raise graph_too_large(size, graph_limit_bytes(limit_bytes))
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
    limit_bytes = int(sys.argv[5]) if len(sys.argv) > 5 else MAX_WEIGHTS_BYTES
    if (reason := confine(JailLevel(sys.argv[4]), graph_limit_bytes(limit_bytes))) is not None:
        _say(too_open=reason)
        return
    from services.policies.unfit import UnfitError

    try:
        convert(content, weights.suffix, manifest_text, out, limit_bytes)
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
