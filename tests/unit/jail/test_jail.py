"""The jail's levels, its filter of system calls on both machines, and a child with a folder that tries to break out."""

import json
import os
import struct
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from api_schemas.jail_report import JailReport, weakest
from jail import landlock, seccomp
from jail.detection import detect
from jail.entering import JailError, enter
from jail.environment import jail_environment
from jail.level import Jail, JailLevel, Layer, too_open
from jail.needs import Needs
from jail.system_calls import AUDIT_ARCH, machine, number
from tests import ROOT

WHOLE = Jail.of(Layer)
LIMITS = (Layer.LIMITS, Layer.NO_NEW_PRIVILEGES)


@pytest.mark.parametrize(
    ("layers", "level"),
    [
        ((), JailLevel.NONE),
        ((Layer.LIMITS,), JailLevel.NONE),
        (LIMITS, JailLevel.LIMITS),
        ((*LIMITS, Layer.SYSTEM_CALLS, Layer.UNPRIVILEGED_USER), JailLevel.LIMITS),
        ((*LIMITS, Layer.LANDLOCK_FILES), JailLevel.FILESYSTEM),
        ((*LIMITS, Layer.LANDLOCK_FILES, Layer.SYSTEM_CALLS), JailLevel.FILESYSTEM),
        ((*LIMITS, Layer.LANDLOCK_FILES, Layer.SYSTEM_CALLS, Layer.UNPRIVILEGED_USER), JailLevel.FULL),
        (tuple(Layer), JailLevel.FULL),
    ],
)
def test_a_level_needs_all_its_walls_and_those_before(layers, level):
    assert Jail.of(layers).level is level


def test_what_is_too_open_says_what_is_missing():
    assert too_open(WHOLE, JailLevel.FULL) is None
    assert too_open(Jail(LIMITS), JailLevel.LIMITS) is None
    reason = too_open(Jail(LIMITS), JailLevel.FULL)
    assert reason is not None
    assert "reaches level limits" in reason
    assert "asks for full" in reason
    assert "missing: landlock-files, unprivileged-user, system-calls" in reason


def test_the_weakest_of_several_jails():
    strong, weak = JailReport.of(WHOLE), JailReport.of(Jail(LIMITS))
    assert weakest([strong, None, weak, strong]) == weak
    assert weakest([None]) is None
    assert str(weak) == "limits (limits, no-new-privileges)"


def _verdict(code: bytes, arch: int, call: int, arguments: tuple[int, ...] = ()) -> int:
    """What the kernel would do: the few instructions that the filter has, carried out."""
    data = struct.pack("<IIQ6Q", call, arch, 0, *arguments, *(0,) * (6 - len(arguments)))
    at, value = 0, 0
    while True:
        what, if_true, if_false, given = struct.unpack_from("<HBBI", code, 8 * at)
        at += 1
        if what == 0x20:
            (value,) = struct.unpack_from("<I", data, given)
        elif what == 0x54:
            value &= given
        elif what == 0x06:
            return given
        else:
            holds = value == given if what == 0x15 else value >= given
            at += if_true if holds else if_false


ALLOW, EPERM, ENOSYS, KILL = 0x7FFF0000, 0x50001, 0x50026, 0x80000000
CLONE_OF_A_THREAD = 0x3D0F00
PID = 4711


@pytest.mark.parametrize("on", AUDIT_ARCH)
@pytest.mark.parametrize("files", [False, True])
def test_the_filter_lets_through_what_is_needed_and_nothing_else(on, files):
    code = seccomp.program(on, PID, files=files, executable_memory=files)

    def verdict(name: str, *arguments: int) -> int:
        call = number(name, on)
        assert call is not None
        return _verdict(code, AUDIT_ARCH[on], call, arguments)

    assert verdict("read") == verdict("write") == verdict("exit_group") == ALLOW
    assert verdict("openat") == (ALLOW if files else EPERM)
    assert verdict("mmap", 0, 4096, 3) == ALLOW
    assert verdict("mmap", 0, 4096, 7) == verdict("mprotect", 0, 4096, 5) == (ALLOW if files else EPERM)
    assert verdict("clone", CLONE_OF_A_THREAD) == ALLOW
    assert verdict("clone", 17) == EPERM  # SIGCHLD: a fork
    assert verdict("clone3") == ENOSYS
    assert verdict("tgkill", PID, PID, 6) == ALLOW
    assert verdict("tgkill", 1, 1, 9) == EPERM
    assert verdict("prlimit64", 0, 7, 0, 0x7FFF_0000_1000) == ALLOW
    assert verdict("prlimit64", 0, 7, 0x7FFF_0000_1000) == EPERM
    assert verdict("prlimit64", 0, 7, 0x7FFF_0000_0000) == EPERM  # whose lower half is 0
    assert verdict("fcntl", 0, 4) == (ALLOW if files else EPERM)
    assert verdict("fcntl", 0, 8) == EPERM
    assert verdict("ioctl") == EPERM
    assert _verdict(code, AUDIT_ARCH[on], 500) == ENOSYS
    assert _verdict(code, AUDIT_ARCH[on], 0x40000000 + 1) == EPERM or on == "aarch64"
    assert _verdict(code, 0x40000003, number("read", on) or 0) == KILL  # i386
    allowed = sum(_verdict(code, AUDIT_ARCH[on], call) == ALLOW for call in range(463))
    assert allowed < (110 if files else 60)


FORBIDDEN_X86_64 = {"socket": 41, "connect": 42, "fork": 57, "vfork": 58, "execve": 59, "kill": 62, "ptrace": 101, "setuid": 105}


@pytest.mark.parametrize("call", FORBIDDEN_X86_64.values(), ids=FORBIDDEN_X86_64)
def test_the_filter_forbids_by_number(call):
    code = seccomp.program("x86_64", PID, files=True, executable_memory=True)
    assert _verdict(code, AUDIT_ARCH["x86_64"], call) == EPERM


def _escape(secret: Path, folder: Path) -> dict:
    command = [sys.executable, "-P", "-m", "tests.unit.jail.jail_escape", str(secret)]
    ran = subprocess.run(command, cwd=folder, env=jail_environment(), capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def test_a_child_with_a_folder_has_that_folder_and_the_libraries_alone(tmp_path):
    if not landlock.abi() or machine() is None:
        print("this kernel has no Landlock, or the machine is of an unknown kind")
        pytest.skip("this kernel has no Landlock, or the machine is of an unknown kind")
    secret, folder = tmp_path / "farm" / "tokens.json", tmp_path / "work"
    secret.parent.mkdir()
    folder.mkdir()
    secret.write_text("secret")
    secret.chmod(0o644)
    found = _escape(secret, folder)
    allowed = set(found["allowed"])
    assert not [name for name, error in found["met"].items() if name not in allowed and error is None]
    assert not [(name, error) for name, error in found["met"].items() if name in allowed and error is not None]
    assert found["jail"] == JailLevel.FULL
    assert found["user"] != 0
    assert not Path("/tmp/trifarm-escape").exists()


def test_a_jail_is_entered_by_the_first_thread_alone():
    go_on = threading.Event()
    thread = threading.Thread(target=go_on.wait)
    thread.start()
    try:
        with pytest.raises(JailError, match="threads run already"):
            enter(Needs(1))
    finally:
        go_on.set()
        thread.join()


def test_nothing_of_the_environment_goes_along(monkeypatch):
    monkeypatch.setenv("TRIFARM_ADMIN_TOKEN", "secret")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    environment = jail_environment()
    assert "secret" not in environment.values()
    assert environment["ORT_DISABLE_TELEMETRY"] == "1"


def _without_landlock(code: str) -> str:
    command = [sys.executable, str(ROOT / "tests" / "without_landlock.py"), "-c", code]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.strip()


DETECT = "from jail.detection import detect; print(detect().level)"
POLICY = """
import pathlib, numpy
from jail.level import JailLevel
from robot_farm.policy.jail import JailedPolicy, PolicyFailedError
with JailedPolicy("p", pathlib.Path({graph!r}), least=JailLevel("{least}")) as policy:
    try:
        policy.reset()
        print("runs in", policy.jail.level)
    except PolicyFailedError as error:
        print(error.kind, error)
"""


@pytest.mark.skipif(
    not landlock.abi() or machine() is None, reason="this kernel has no Landlock or no filters to take it away with"
)
def test_on_a_kernel_without_landlock_the_level_is_lower_and_the_setting_refuses(tmp_path):
    from tests.graphs import linear

    graph = str(linear(tmp_path / "p.onnx"))
    assert detect().level is JailLevel.FULL
    assert _without_landlock(DETECT) == "limits"
    assert _without_landlock(POLICY.format(graph=graph, least="limits")) == "runs in limits"
    refused = _without_landlock(POLICY.format(graph=graph, least="filesystem"))
    assert refused.startswith("platform_error the policy is not run: the jail here reaches level limits"), refused
