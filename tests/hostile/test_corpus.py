"""Every hostile file is refused with a typed problem that says what to do, at its price, and no canary fires."""

import socket
import time
from pathlib import Path

import pytest

from api_schemas.policy import MAX_WEIGHTS_BYTES
from services.errors import ServiceError
from services.policies import conversion
from services.policies.intake import check_weights, weights_format
from services.policies.jailed_conversion import convert
from tests.hostile.corpus import corpus
from tests.hostile.measured import measured_children
from tests.hostile.valid import MANIFEST, VALID, canary_pickle, sized

CHECK_COUNTS_TO, CHECK_MEMORY_BYTES = 10_000_000, 64 * 2**20
CHILD_CPU_S, CHILD_MEMORY_BYTES = 5.0, 2**30
NAMES = list(corpus(Path("canary"), 1))


@pytest.fixture(scope="module")
def trap(tmp_path_factory):
    """The file that a canary writes, and a socket where it calls."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        yield tmp_path_factory.mktemp("trap") / "canary", server


@pytest.fixture(scope="module")
def cases(trap):
    canary, server = trap
    return corpus(canary, server.getsockname()[1])


@pytest.fixture
def silent(trap):
    canary, server = trap
    yield
    assert not canary.exists()
    with pytest.raises(BlockingIOError):
        server.accept()


def peak_bytes():
    return (
        int(next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")).split()[1])
        * 1024
    )


def check(path, filename):
    """What the pre-check says, its CPU time in seconds, and the memory that it added at its peak."""
    Path("/proc/self/clear_refs").write_text("5")
    before_bytes, began_s = peak_bytes(), time.thread_time()
    found = None
    try:
        check_weights(path, weights_format(filename), MAX_WEIGHTS_BYTES, filename)
    except ServiceError as error:
        found = error
    return found, time.thread_time() - began_s, peak_bytes() - before_bytes


def assert_quick(cpu_s):
    """A check takes no longer than this processor takes to count, some 0.2 s; a file read whole would take many times that."""
    began_s = time.thread_time()
    for _ in range(CHECK_COUNTS_TO):
        pass
    assert cpu_s <= time.thread_time() - began_s


async def converted(path, tmp_path, manifest=MANIFEST):
    """What the converting child says, and what it cost, start-up included."""
    with measured_children() as cost:
        try:
            return await convert(path, manifest, tmp_path, 60), cost
        except ServiceError as error:
            return error, cost


def assert_cheap(cost):
    assert cost.cpu_s <= CHILD_CPU_S
    assert 0 < cost.memory_bytes <= CHILD_MEMORY_BYTES


@pytest.mark.parametrize("name", NAMES)
async def test_a_hostile_file_is_refused(name, cases, silent, tmp_path):
    case = cases[name]
    path = tmp_path / f"weights{Path(case.filename).suffix}"
    path.write_bytes(case.content)
    found, cpu_s, memory_bytes = check(path, case.filename)
    assert_quick(cpu_s)
    assert memory_bytes <= CHECK_MEMORY_BYTES
    assert (found is not None) == case.before_parsing, found
    if found is None:
        found, cost = await converted(path, tmp_path)
        assert_cheap(cost)
    assert isinstance(found, ServiceError), found
    assert 400 <= found.status < 500
    assert case.slug in (found.slug, "")
    assert {"file", "part", "instead"} <= set(found.members)
    assert ("`trifarm pack " in found.detail) == case.packs, found.detail


async def test_the_pickles_within_the_settings_of_an_archive_are_never_read(trap, silent, tmp_path):
    import base64
    import json

    from tests.hostile.valid import DATA, sb3_entries, zipped

    fires = base64.b64encode(canary_pickle(trap[0], trap[1].getsockname()[1])).decode()
    data = {name: value | {":serialized:": fires} for name, value in DATA.items()}
    data["policy_kwargs"] |= {":type:": "<class 'dict'>"}
    optimizer = {"policy.optimizer.pth": canary_pickle(trap[0], trap[1].getsockname()[1])}
    path = tmp_path / "weights.zip"
    path.write_bytes(zipped(sb3_entries() | {"data": json.dumps(data).encode()} | optimizer))
    found, _, _ = check(path, "p.zip")
    assert found is None
    accepted, _ = await converted(path, tmp_path)
    assert not isinstance(accepted, ServiceError), accepted


async def test_the_canary_of_these_tests_does_fire(tmp_path):
    import pickle

    with socket.create_server(("127.0.0.1", 0)) as server:
        pickle.loads(canary_pickle(tmp_path / "canary", server.getsockname()[1]))
        server.accept()[0].close()
    assert (tmp_path / "canary").read_text() == "fired"


@pytest.mark.parametrize("kind", VALID)
async def test_a_valid_file_of_each_kind_is_accepted_at_its_price(kind, tmp_path):
    path = tmp_path / f"weights.{kind}"
    path.write_bytes(VALID[kind]())
    found, cpu_s, _ = check(path, path.name)
    assert found is None
    assert_quick(cpu_s)
    accepted, cost = await converted(path, tmp_path)
    assert not isinstance(accepted, ServiceError), accepted
    assert accepted.warnings == ()
    assert_cheap(cost)


@pytest.mark.parametrize("kind", VALID)
async def test_the_largest_file_of_each_kind_is_judged_at_the_same_price(kind, tmp_path):
    """64 MiB of weights that are well formed: whether they are taken or refused, they cost no more than others."""
    path = tmp_path / f"weights.{kind}"
    path.write_bytes(sized(kind, 62 * 2**20))
    assert 60 * 2**20 < path.stat().st_size <= MAX_WEIGHTS_BYTES
    found, cpu_s, memory_bytes = check(path, path.name)
    print(f"{kind}: pre-check {cpu_s:.3f} s, {memory_bytes / 2**20:.0f} MB")
    assert found is None
    said, cost = await converted(path, tmp_path)
    print(f"{kind}: child {cost.cpu_s:.2f} s, {cost.memory_bytes / 2**20:.0f} MB, {said}")
    assert_cheap(cost)


def test_the_converting_child_has_no_more_than_a_gigabyte_of_addresses():
    """That the kernel holds it to this is what the graphs of the corpus that ask for more show."""
    assert conversion.MEMORY_LIMIT_BYTES <= 2**30
    assert conversion.CPU_LIMIT_S <= CHILD_CPU_S
