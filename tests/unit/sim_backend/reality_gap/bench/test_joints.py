import json

import pytest

from sim_backend.reality_gap.bench import joints
from sim_backend.refusal import EXIT_UNUSABLE


@pytest.mark.parametrize("out", ["/proc/nothing", "/dev/null"])
def test_a_folder_that_cannot_be_used_is_named(capsys, out):
    assert joints.main(["--cases", "1", "--out", out, "--json"]) == EXIT_UNUSABLE
    assert json.loads(capsys.readouterr().out)["error"]["detail"].startswith(f"cannot use {out}: ")
    assert joints.main(["--cases", "1", "--out", out]) == EXIT_UNUSABLE
    assert capsys.readouterr().err.startswith(f"error: cannot use {out}: ")
