"""Certificates of the bus: for whom they are, how long they last, and that every process of a farm makes the same authority."""

import base64
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from services.errors import Refused
from services.joining.authority import Authority
from services.signing import FarmKey

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
AUTHORITY = Authority.of(FarmKey(bytes(32)))


def request(key, name="robot-0"):
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    kind = None if isinstance(key, Ed25519PrivateKey) else hashes.SHA256()
    signed = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(key, kind)
    return signed.public_bytes(serialization.Encoding.PEM).decode()


def of_version_8(pem):
    plain = x509.load_pem_x509_csr(pem.encode()).public_bytes(serialization.Encoding.DER)
    changed = plain.replace(b"\x02\x01\x00", b"\x02\x01\x07", 1)  # the first integer of a request is its version, from 0
    begin, *_, end = pem.strip().splitlines()
    return "\n".join([begin, base64.b64encode(changed).decode(), end])


def read(pem):
    return x509.load_pem_x509_certificate(pem.encode())


def test_the_same_key_makes_the_same_authority_and_another_another():
    assert Authority.of(FarmKey(bytes(32))).certificate == AUTHORITY.certificate
    assert Authority.of(FarmKey(bytes(31) + b"1")).certificate != AUTHORITY.certificate
    read(AUTHORITY.certificate).verify_directly_issued_by(read(AUTHORITY.certificate))


def test_a_robots_certificate_is_for_its_key_and_the_name_that_the_farm_gives():
    key = Ed25519PrivateKey.generate()
    made = read(AUTHORITY.of_robot("robot-3", request(key, "robot-99"), NOW, 3600))
    made.verify_directly_issued_by(read(AUTHORITY.certificate))
    assert made.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value == "robot-3"
    assert made.public_key() == key.public_key()
    assert made.not_valid_after_utc == NOW + timedelta(hours=1)
    uses = made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert list(uses) == [ExtendedKeyUsageOID.CLIENT_AUTH]  # with it a robot cannot pass for the router
    assert not made.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_a_router_is_certified_for_the_hosts_by_which_it_is_reached():
    made = read(AUTHORITY.of_services({"farm.example.org", "10.0.0.1", "fd00::1"}).certificate)
    names = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["farm.example.org"]
    assert {str(each) for each in names.get_values_for_type(x509.IPAddress)} == {"10.0.0.1", "fd00::1"}


def test_what_is_no_signing_request_of_the_right_kind_is_refused():
    good = request(Ed25519PrivateKey.generate())
    middle = len(good) // 2
    tampered = good[:middle] + ("A" if good[middle] != "A" else "B") + good[middle + 1 :]
    for unfit in ("", "hello", tampered, of_version_8(good), request(ec.generate_private_key(ec.SECP256R1()))):
        with pytest.raises(Refused, match="signing request"):
            AUTHORITY.of_robot("robot-0", unfit, NOW, 3600)
