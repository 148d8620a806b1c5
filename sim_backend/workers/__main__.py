"""The command behind ``trifarm cluster status``: ``python -m sim_backend.workers ADDRESS [--json]``."""

import argparse
import json
import sys

from sim_backend.refusal import EXIT_OTHER, ended, refused
from sim_backend.workers.cluster import status
from sim_backend.workers.pool import WorkersError


def main(arguments: list[str] | None = None) -> int:
    """Show what a cluster is made of; returns the exit code."""
    parser = argparse.ArgumentParser(prog="trifarm cluster status", description="What a Ray cluster is made of.")
    parser.add_argument("address", help="HOST:PORT of the Ray that runs")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    try:
        found = status(options.address)
    except WorkersError as error:
        return refused(error, options.json, EXIT_OTHER)
    if options.json:
        print(json.dumps(found, indent=2))
        return 0
    alive = sum(node["alive"] for node in found["nodes"])
    token = "this side sends a token" if found["sends_token"] else "this side sends no token"
    cores = f"{found['free_cpus']:g} of {found['cpus']:g} cores free"
    print(f"Ray {found['ray']} at {found['address']}, {token}: {alive} nodes, {cores}")
    for node in found["nodes"]:
        print(f"{node['address']}  {'alive' if node['alive'] else 'gone'}  {node['cpus']:g} cores")
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
