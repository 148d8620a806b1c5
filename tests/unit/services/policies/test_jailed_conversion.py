import asyncio
import os
import subprocess
import sys
from pathlib import Path

import pytest

from api_schemas.policy import LAYOUTS
from jail import landlock
from jail.level import JailLevel
from services.child_process import Ended
from services.errors import Refused, Unavailable
from services.policies import jailed_conversion
from services.policies.jailed_conversion import convert
from tests.integration.farm_process import small_policy


def files(tmp_path):
    weights = tmp_path / "w.safetensors"
    content, manifest = small_policy()
    weights.write_bytes(content)
    return weights, manifest, tmp_path


async def test_a_good_policy_is_converted_and_its_secrets_stay_here(tmp_path, monkeypatch):
    monkeypatch.setenv("TRIFARM_ADMIN_TOKEN", "trifarm_a_b")
    converted = await convert(*files(tmp_path), 60)
    assert converted.warnings == ()
    assert converted.graph.stat().st_size > 1000


async def test_a_graph_of_more_than_twice_what_may_be_sent_is_refused(tmp_path):
    weights, manifest, folder = files(tmp_path)
    weights.write_bytes(small_policy(width=1200)[0])  # 300 kB, as if it had come packed
    with pytest.raises(Refused, match=r"unpacked, as robots run it, the policy has 30\d{4} bytes; at most 265536 are") as refusal:
        await convert(weights, manifest, folder, 60, limit_bytes=100_000)
    assert (refusal.value.slug, (folder / "policy.onnx").exists()) == ("graph-too-large", False)
    assert (await convert(weights, manifest, folder, 60, limit_bytes=150_000)).graph.stat().st_size > 300_000


async def test_a_child_that_takes_too_long_is_ended(tmp_path):
    with pytest.raises(Refused, match=r"more than 0\.05 s"):
        await convert(*files(tmp_path), 0.05)


async def test_a_child_that_breaks_is_a_refusal(tmp_path):
    weights, manifest, folder = files(tmp_path)
    with pytest.raises(Refused, match="nearest ready-made layout"):
        await convert(weights, LAYOUTS["pose"], folder, 60)
    with pytest.raises(Refused, match="cannot be converted"):
        await convert(tmp_path / "missing.onnx", manifest, folder, 60)


@pytest.mark.parametrize(
    "said",
    [
        b"",
        b"{",
        b"\xff\n",
        b"[]\n",
        b"[" * 50_000,
        b'{"problem": {}}',
        b'{"problem": {"why": []}}',
        b'{"problem": {"why": "", "x": ""}}',
        b'{"problem": 3}',
        b'{"warnings": [1]}',
        b'{"warnings": null}',
        b'{"converted": true}\nnonsense',
    ],
)
def test_whatever_a_taken_over_child_says_is_a_refusal(said, tmp_path):
    with pytest.raises(Refused, match="the converting process ended with status 0"):
        jailed_conversion._read(Ended(0, said), tmp_path / "out.onnx", "p.zip")


async def test_a_jail_that_is_closed_enough_converts(tmp_path):
    if not landlock.abi():
        pytest.skip("this kernel has no Landlock")
    converted = await convert(*files(tmp_path), 60, JailLevel.FULL)
    assert converted.warnings == ()


def test_a_jail_that_is_too_open_takes_nothing(tmp_path):
    if not landlock.abi():
        pytest.skip("this kernel has no Landlock to take away")
    files(tmp_path)
    root = Path(__file__).parents[4]
    command = [sys.executable, str(root / "tests" / "without_landlock.py"), "-m", __name__, str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(root)}
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("jail-too-open The farm takes no policies now: the jail here reaches level limits"), ran.stdout
    assert not (tmp_path / "policy.onnx").exists()


if __name__ == "__main__":
    try:
        asyncio.run(convert(*files(Path(sys.argv[1])), 60, JailLevel.FILESYSTEM))
    except Unavailable as refusal:
        print(refusal.slug, refusal.detail)
