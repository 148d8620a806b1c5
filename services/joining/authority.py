"""The farm's certificate authority for its bus: made of the farm's key, so that every process that has the key has it."""

import ipaddress
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from api_schemas.bus import Identity
from services.errors import Refused
from services.signing import FarmKey

USE = "certificates of the bus"
SERVICES = "services of the farm"
"""The common name of services. It has spaces, so that no robot can be called so."""
BEGIN = datetime(2020, 1, 1, tzinfo=UTC)
END = datetime(2100, 1, 1, tzinfo=UTC)
"""Of the authority, and of services, which hold the key that could make them a new certificate at any time."""
CLOCKS_APART = timedelta(days=1)
"""A robot's certificate is valid this much earlier than it was made, for clocks that are behind; its key is younger anyhow."""


@dataclass(frozen=True)
class Authority:
    """One farm's authority; its key is never written down."""

    _key: Ed25519PrivateKey

    @classmethod
    def of(cls, key: FarmKey) -> "Authority":
        """That of the farm with this key, always the same one."""
        return cls.of_secret(key.secret_for(USE))

    @classmethod
    def of_secret(cls, secret: bytes) -> "Authority":
        """The same, for who has of the farm's key only what was made of it for certificates (32 bytes)."""
        return cls(Ed25519PrivateKey.from_private_bytes(secret))

    @property
    def certificate(self) -> str:
        """What vouches for all others, in PEM."""
        only_signs = x509.KeyUsage(
            digital_signature=False,
            content_commitment=False,
            key_encipherment=False,
            data_encipherment=False,
            key_agreement=False,
            key_cert_sign=True,
            crl_sign=False,
            encipher_only=False,
            decipher_only=False,
        )
        made = self._begun(self._name, self._key.public_key(), BEGIN, END).serial_number(1)
        made = made.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        return self._signed(made.add_extension(only_signs, critical=True))

    def of_robot(self, robot: str, signing_request: str, now: datetime, lasts_s: float) -> str:
        """A robot's certificate in PEM, for the key that signed the request; of the request nothing else is used.

        Raises:
            Refused: the request cannot be read, has another kind of key or was not signed with it.
        """
        begin, end = now - CLOCKS_APART, now + timedelta(seconds=lasts_s)
        made = self._begun(_name(robot), _key_of(signing_request), begin, end).serial_number(x509.random_serial_number())
        return self._signed(_to_join(made, ExtendedKeyUsageOID.CLIENT_AUTH))

    def of_services(self, reached_as: Iterable[str] = ()) -> Identity:
        """What a process of the services shows on the bus, with a key of its own; ``reached_as`` are hosts if it listens."""
        key, names = Ed25519PrivateKey.generate(), [_host(each) for each in sorted(set(reached_as))]
        made = self._begun(_name(SERVICES), key.public_key(), BEGIN, END).serial_number(x509.random_serial_number())
        uses = (ExtendedKeyUsageOID.CLIENT_AUTH, *((ExtendedKeyUsageOID.SERVER_AUTH,) if names else ()))
        made = _to_join(made, *uses)
        if names:
            made = made.add_extension(x509.SubjectAlternativeName(names), critical=False)
        private = key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        ).decode()
        return Identity(self._signed(made), private, self.certificate)

    @property
    def _name(self) -> x509.Name:
        # Two farms whose robots were mixed up tell each other apart by it.
        return _name(f"trifarm bus {self._key.public_key().public_bytes_raw().hex()[:16]}")

    def _begun(self, subject: x509.Name, key: Ed25519PublicKey, begin: datetime, end: datetime) -> x509.CertificateBuilder:
        built = x509.CertificateBuilder().subject_name(subject).issuer_name(self._name).public_key(key)
        return built.not_valid_before(begin).not_valid_after(end)

    def _signed(self, made: x509.CertificateBuilder) -> str:
        return made.sign(self._key, None).public_bytes(serialization.Encoding.PEM).decode()


def _to_join(made: x509.CertificateBuilder, *uses: x509.ObjectIdentifier) -> x509.CertificateBuilder:
    made = made.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    return made.add_extension(x509.ExtendedKeyUsage(uses), critical=True)


def _key_of(signing_request: str) -> Ed25519PublicKey:
    try:
        asked = x509.load_pem_x509_csr(signing_request.encode())
        key, signed = asked.public_key(), asked.is_signature_valid
    except Exception as error:  # the library's errors over a stranger's bytes have no common class; InvalidVersion is one
        raise Refused("signing-request-unfit", f"The signing request cannot be read as PKCS#10 in PEM: {error}") from error
    if not isinstance(key, Ed25519PublicKey) or not signed:
        detail = "The signing request must have an Ed25519 key and be signed with it; make it again as robot_farm does."
        raise Refused("signing-request-unfit", detail)
    return key


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
