"""What readers of other people make of a log: rerun's converter, and the Go library of MCAP; ``python -m`` it with a log."""

import argparse
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

DOCTOR = Path(__file__).parent / "doctor.go"
LIBRARY = "github.com/foxglove/mcap/go/mcap@v1.7.2"
COUNT = """
import json, sys
import rerun
from rerun.chunk import RrdReader

rows, scenes = {}, []
for chunk in RrdReader(sys.argv[1]).stream():
    batch = chunk.to_record_batch()
    path = str(chunk.entity_path)
    rows[path] = rows.get(path, 0) + batch.num_rows
    for name in batch.schema.names:
        if name.endswith("SceneUpdate:message"):
            scenes += [len(message["entities"]) for row in batch.column(name).to_pylist() for message in row]
print(json.dumps({"version": rerun.__version__, "rows": rows, "scene_entities": sum(scenes)}))
"""


def rerun_executable() -> Path | None:
    """Where ``rerun`` is installed: what TRIFARM_RERUN names, or what is on the path."""
    found = os.environ.get("TRIFARM_RERUN") or shutil.which("rerun")
    return None if found is None else Path(found)


def doctor_executable() -> Path | None:
    """The program made of ``doctor.go``, as TRIFARM_MCAP_DOCTOR names it."""
    found = os.environ.get("TRIFARM_MCAP_DOCTOR")
    return None if found is None else Path(found)


def by_rerun(executable: Path, log: Path) -> dict:
    """How rerun checks and converts a log, and what it then has of it."""
    checked = subprocess.run([executable, "mcap", "check", log], capture_output=True, text=True, timeout=300, check=False)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "log.rrd"
        command = [executable, "mcap", "convert", log, "-o", made, "--application-id", "trifarm"]
        converted = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        said = converted.stdout + converted.stderr
        counted = subprocess.run(
            [executable.parent / "python", "-c", COUNT, made], capture_output=True, text=True, timeout=300, check=True
        )
    return {
        "check_exit_code": checked.returncode,
        "convert_exit_code": converted.returncode,
        "errors": [line for line in said.splitlines() if "ERROR" in line or "WARN" in line],
        **json.loads(counted.stdout.splitlines()[-1]),
    }


def by_go(executable: Path, log: Path) -> dict:
    """What the Go library finds in a log, and what is wrong with it."""
    return json.loads(subprocess.run([executable, log], capture_output=True, text=True, timeout=300, check=False).stdout)


def main() -> None:
    """Has each reader that is there read a log, and prints what they found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    found: dict[str, object] = {"log_bytes": given.log.stat().st_size}
    if (rerun := rerun_executable()) is not None:
        found["rerun"] = by_rerun(rerun, given.log)
    if (doctor := doctor_executable()) is not None:
        found["go"] = {"library": LIBRARY, **by_go(doctor, given.log)}
    text = json.dumps(found, indent=1)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
