"""Policies that see go the whole path."""

import numpy as np
import pytest

from sim_backend.vision.cameras import Cameras, CamerasMissingError
from tests.end_to_end.farm import Farm
from tests.graphs import seeing
from trial_logs.reader import read_log

pytestmark = pytest.mark.scale


@pytest.fixture(scope="module", autouse=True)
def eyes():
    try:
        Cameras().close()
    except CamerasMissingError as error:
        pytest.skip(str(error))


def test_a_policy_that_sees_is_submitted_tried_and_reported(tmp_path):
    with Farm(tmp_path / "farm", robots=1) as farm:
        job = farm.submit(seeing(tmp_path / "p.onnx"), layout="images", task="reach", trials=1)
        report = farm.report(job)
        farm.run("fetch", job, "--to", str(tmp_path / "logs"))
    assert report["errors"] == {"policy": 0, "platform": 0} if "errors" in report else report["platform_faults"] == 0
    assert [row["outcome"]["kind"] in ("succeeded", "failed") for row in report["per_trial"]] == [True]
    log = read_log(tmp_path / "logs" / "trial-000.mcap")
    assert log.manifest is not None and '"images":{' in log.manifest
    assert np.ptp(log.action, axis=0).max() > 1e-3, "what it sees changes while the robot moves"
    assert 0.02 < log.action.mean() < 0.28, "it sees neither black nor white"
