"""A receiver of webhooks: a real https server on this machine, which keeps what it was sent."""

import asyncio
import datetime
import ipaddress
import ssl
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from services.webhooks.calling import Reach

HOST = "receiver.example.org"


@dataclass
class Receiver:
    """What came in, and what is answered; ``None`` is no answer at all."""

    answer: bytes | None = b"HTTP/1.1 204 No Content\r\n\r\n"
    port: int = 0
    requests: list[bytes] = field(default_factory=list)
    connections: int = 0

    @property
    def url(self):
        return f"https://{HOST}:{self.port}/hook?of=mine"

    async def take(self, reader, writer):
        self.connections += 1
        try:
            head = await reader.readuntil(b"\r\n\r\n")
            length = int(head.lower().partition(b"content-length: ")[2].partition(b"\r\n")[0])
            self.requests.append(head + await reader.readexactly(length))
            if self.answer is None:
                await asyncio.sleep(300)
            writer.write(self.answer or b"")
            await writer.drain()
        except (OSError, asyncio.IncompleteReadError, asyncio.CancelledError):
            pass
        finally:
            writer.close()


@pytest.fixture(scope="session")
def certificate(tmp_path_factory):
    """A certificate of the receiver's name that vouches for itself, and its key, in one file."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, HOST)])
    now = datetime.datetime.now(datetime.UTC)
    names = x509.SubjectAlternativeName([x509.DNSName(HOST), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(minutes=5))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(names, critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    path = tmp_path_factory.mktemp("webhooks") / "receiver.pem"
    form = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    path.write_bytes(key.private_bytes(serialization.Encoding.PEM, *form) + made.public_bytes(serialization.Encoding.PEM))
    return path


@pytest.fixture
def receiving(certificate):
    @asynccontextmanager
    async def start(**more):
        receiver = Receiver(**more)
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        context.load_cert_chain(certificate)
        server = await asyncio.start_server(receiver.take, "127.0.0.1", 0, ssl=context)
        receiver.port = server.sockets[0].getsockname()[1]
        try:
            yield receiver
        finally:
            server.close()

    return start


@pytest.fixture
def here(certificate):
    """A reach that takes the receiver's name for this machine and may call it, as no farm may."""

    async def resolve(_host, _port):
        return ["127.0.0.1"]

    return Reach(resolve, lambda _: True, ssl.create_default_context(cafile=certificate), within_s=120.0)
