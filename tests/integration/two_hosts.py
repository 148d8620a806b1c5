"""Two hosts on this machine: network namespaces with a cable between them, and another from here to that of the services."""

import os
import shutil
import subprocess
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID


@dataclass(frozen=True)
class Hosts:
    """``services`` and ``robots`` begin commands that run there; ``address`` is that of the services, from both sides."""

    services: tuple[str, ...]
    robots: tuple[str, ...]
    address: str

    def cut_off_robots(self):
        """Pull the cable of the robots out: nothing more arrives on either side, not even a word of parting."""
        cables = subprocess.run([*self.robots, "ip", "-o", "link"], check=True, capture_output=True, text=True).stdout
        (cable,) = [line.split()[1].partition("@")[0] for line in cables.splitlines() if "@" in line and "link-netns" in line]
        subprocess.run([*self.robots, "ip", "link", "set", cable, "down"], check=True)


def why_not():
    """Why there can be no such hosts here, None if there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "'ip' (iproute2) is not installed"
    tried = subprocess.run(["ip", "netns", "add", _name("try")], capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        return f"no network namespace can be made here: {tried.stderr.strip()}"
    _run("netns", "del", _name("try"))
    return None


@contextmanager
def two_hosts():
    """The hosts; robots reach the services and nobody else."""
    number = os.getpid() % 200 + 20
    services, robots = _name("services"), _name("robots")
    address = f"10.{number}.0.1"
    try:
        for host in (services, robots):
            _run("netns", "add", host)
            _run("-n", host, "link", "set", "lo", "up")
        # To robots and to us leads a cable each, on which the services have one and the same address.
        _cable(services, f"r{number}", f"{address}/32", f"10.{number}.1.2", robots)
        _cable(services, f"u{number}", f"{address}/32", f"10.{number}.2.2", None)
        yield Hosts(_within(services), _within(robots), address)
    finally:
        for host in (services, robots):
            subprocess.run(["ip", "netns", "del", host], capture_output=True, check=False)  # with it go its cables


def _cable(first, name, address, other_address, second):
    _run("-n", first, "link", "add", f"{name}a", "type", "veth", "peer", "name", f"{name}b")
    other = ("-n", second) if second else ()
    _run("-n", first, "link", "set", f"{name}b", "netns", second or "1")
    _run("-n", first, "address", "add", address, "dev", f"{name}a")
    _run("-n", first, "link", "set", f"{name}a", "up")
    _run("-n", first, "route", "add", f"{other_address}/32", "dev", f"{name}a")
    _run(*other, "address", "add", f"{other_address}/32", "dev", f"{name}b")
    _run(*other, "link", "set", f"{name}b", "up")
    _run(*other, "route", "add", address, "dev", f"{name}b")


def _name(which):
    return f"trifarm-{which}-{os.getpid()}"


def _within(host):
    return ("ip", "netns", "exec", host)


def _run(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)


@pytest.fixture
def hosts():
    reason = why_not()
    if reason is not None:
        pytest.skip(reason)
    with two_hosts() as both:
        yield both


def https_files(folder: Path, address: str) -> dict[str, Path]:
    """Settings of a services process that serves https under this address, with a certificate that vouches for itself."""
    key, name = ec.generate_private_key(ec.SECP256R1()), x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "farm")])
    now = datetime.now(UTC)
    made = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key()).serial_number(1)
    made = made.not_valid_before(now - timedelta(days=1)).not_valid_after(now + timedelta(days=2))
    made = made.add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address(address))]), critical=False)
    made = made.add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True).sign(key, hashes.SHA256())
    certificate, private = folder / "https.pem", folder / "https-key.pem"
    certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    private.write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return {"tls_certificate": certificate, "tls_key": private}
