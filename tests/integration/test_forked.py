"""Processes that tests fork have nothing of what another fork server in the same process had to import."""

import subprocess
import sys

CODE = """
import multiprocessing, sys
context = multiprocessing.get_context("forkserver")
context.set_forkserver_preload(["mujoco"])
first = context.Process(target=print)
first.start()
first.join()
from tests.integration.forked import Forked
for _ in range(2):
    assert Forked("what_is_loaded", [], cwd=sys.argv[1], env={}, errors=sys.argv[1] + "/said").wait(60) == 0
    context.set_forkserver_preload(["mujoco"])
"""
SAYS = """
import os, sys
def main():
    print(os.getppid(), "mujoco" in open("/proc/self/maps").read(), "services.serve" in sys.modules)
"""


def test_a_fork_server_that_workers_began_is_not_the_one_of_services(tmp_path):
    (tmp_path / "what_is_loaded.py").write_text(SAYS)
    code = f"import sys; sys.path.append(sys.argv[1])\n{CODE}"
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True, timeout=120)
    first, second = ((tmp_path / "said").read_text().splitlines())[-2:]
    assert first.split()[1:] == ["False", "True"]
    assert second == first, "and it stays"
