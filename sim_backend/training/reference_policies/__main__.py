"""Lists the shipped policies: ``python -m sim_backend.training.reference_policies [--json]``."""

import json
import sys

from api_schemas.policy import PolicyManifest
from sim_backend.training.reference_policies import folder, names


def listed() -> list[dict]:
    """Name, file, task, memory and success of each, from its manifest and its record."""
    found = []
    for name in names():
        record = json.loads((folder() / f"{name}-record.json").read_text())
        manifest = PolicyManifest.model_validate_json((folder() / f"{name}.json").read_text())
        tried = record["final"] if "final" in record else record["student"]
        rates = {each["physics"]: each["success_rate"] for each in tried}
        memory = manifest.recurrent.value if manifest.recurrent else None
        row = {"name": name, "task": record["settings"]["task"], "memory": memory, "success_rate": rates}
        found.append(row | {"file": str(folder() / f"{name}.safetensors")})
    return found


def main() -> None:
    """The command; see the module's docstring."""
    if "--json" in sys.argv[1:]:
        print(json.dumps({"policies": listed()}, indent=2))
        return
    for row in listed():
        rates = ", ".join(f"{rate:.1%} on {physics} robots" for physics, rate in row["success_rate"].items())
        print(f"{row['name']}: {row['task']}, memory {row['memory'] or 'none'}, {rates}\n  {row['file']}")


if __name__ == "__main__":
    main()
