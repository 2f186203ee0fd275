"""Certificates of an authority of one's own: X.509, ECDSA on P-256.

The common name is `<role>.<number>`, all that the router's access list looks at; the host is the
organizational unit, for people. Only a router's certificate is good for a server, and only the
others' for a client, so that no worker can pose as the router.
"""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage
from cryptography.x509.oid import NameOID

from sumo_dist.errors import SumoError, UsageError

ROUTER = "router"
ROLES = (ROUTER, "robot", "optimizer", "worker", "tracer", "operator")
NUMBERS = 2000  # certificates of a role that an authority can issue, renewals included
HERE = ("localhost", "127.0.0.1", "::1")  # a router's own machine reaches it by these names
AUTHORITY_DAYS = 3650
_SLACK = timedelta(hours=1)  # a host's clock may be behind the authority's by this much

Key = ec.EllipticCurvePrivateKey


class KeysError(SumoError):
    """A key, a certificate or an access list is not what is needed; the message says what is."""


@dataclass(frozen=True)
class Certificate:
    """What a certificate says.

    Attributes:
        role: of ROLES; "" of an authority's own certificate, or one that is not ours.
        number: among those of its role.
        host: it was issued for.
        begins, expires: between which it is valid.
        source: the certificate itself.
    """

    role: str
    number: int
    host: str
    begins: datetime
    expires: datetime
    source: x509.Certificate

    @classmethod
    def of(cls, found: x509.Certificate) -> "Certificate":
        """Read a certificate."""
        role, _, number = _said(found, NameOID.COMMON_NAME).partition(".")
        if role not in ROLES or not number.isdecimal():
            role, number = "", "0"
        host = _said(found, NameOID.ORGANIZATIONAL_UNIT_NAME)
        times = found.not_valid_before_utc, found.not_valid_after_utc
        return cls(role, int(number), host, *times, found)

    def unfit(self, now: datetime | None = None) -> str:
        """Say why it is not valid now; "" if it is."""
        now = now or datetime.now(UTC)
        if now >= self.expires:
            return f"expired on {self.expires:%Y-%m-%d}"
        if now < self.begins:
            return (
                f"not valid before {self.begins:%Y-%m-%d %H:%M} UTC: is this machine's clock right"
            )
        return ""


def new_key() -> Key:
    """Make a private key."""
    return ec.generate_private_key(ec.SECP256R1())


def key_pem(key: Key) -> bytes:
    """Return a private key as text, not encrypted: services start without a person."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def certificate_pem(certificate: x509.Certificate) -> bytes:
    """Return a certificate as text."""
    return certificate.public_bytes(serialization.Encoding.PEM)


def make_authority(key: Key) -> x509.Certificate:
    """Make an authority's certificate, signed by itself."""
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "sumo-dist authority")])
    builder = _builder(name, name, key.public_key(), timedelta(days=AUTHORITY_DAYS))
    return (
        builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )


def issue(
    authority: tuple[x509.Certificate, Key],
    key: ec.EllipticCurvePublicKey,
    name: tuple[str, int, str],
    addresses: Sequence[str],
    lasts: timedelta,
) -> x509.Certificate:
    """Make the certificate of a host's role.

    Args:
        authority: its certificate and key.
        key: the role's.
        name: role, number and host.
        addresses: IP addresses and DNS names by which a router is dialled, its own HERE included;
            of other roles, for people alone.
        lasts: until it expires.
    """
    (ca, ca_key), (role, number, host) = authority, name
    subject = x509.Name(
        [
            x509.NameAttribute(NameOID.COMMON_NAME, f"{role}.{number}"),
            x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, host),
        ]
    )
    here = HERE if role == ROUTER else ()
    names = [_general_name(address) for address in dict.fromkeys([*addresses, host, *here])]
    usage = Usage.SERVER_AUTH if role == ROUTER else Usage.CLIENT_AUTH
    return (
        _builder(subject, ca.subject, key, lasts)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([usage]), critical=True)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key()), critical=False
        )
        .sign(ca_key, hashes.SHA256())
    )


def read_certificate(path: Path) -> Certificate:
    """Read a certificate's file.

    Raises:
        KeysError: there is none, or it holds something else.
    """
    try:
        return Certificate.of(x509.load_pem_x509_certificate(read_file(path)))
    except ValueError:
        raise KeysError(f"{path} is not a certificate (PEM)") from None


def read_key(path: Path) -> Key:
    """Read a private key's file.

    Raises:
        KeysError: there is none, or it holds something else.
    """
    try:
        key = serialization.load_pem_private_key(read_file(path), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise KeysError(f"{path} is not a private key (PEM, elliptic curve, no password)")
    return key


def read_file(path: Path) -> bytes:
    """Read a file of a folder of keys.

    Raises:
        KeysError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise KeysError(f"cannot read {path}: {error.strerror}") from None


def is_issued_by(certificate: Certificate, ca: Certificate) -> bool:
    """Whether an authority has signed a certificate."""
    try:
        certificate.source.verify_directly_issued_by(ca.source)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def checked_address(address: str) -> str:
    """Return an IP address or a DNS name, if it is one.

    Raises:
        UsageError: it is not.
    """
    try:
        _general_name(address)
    except ValueError:
        raise UsageError(f"{address!r} is neither an IP address nor a DNS name") from None
    return address


def _general_name(address: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(address))
    except ValueError:
        labels = address.split(".")
        plain = all(label and label.replace("-", "").replace("_", "").isalnum() for label in labels)
        if not (plain and address.isascii() and len(address) <= 253):
            raise
        return x509.DNSName(address)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, lasts: timedelta
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _SLACK)
        .not_valid_after(now + lasts)
    )


def _key_usage(signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _said(certificate: x509.Certificate, what: x509.ObjectIdentifier) -> str:
    """Return the one attribute of a kind that a subject has; "" if it has none or several."""
    found = certificate.subject.get_attributes_for_oid(what)
    return str(found[0].value) if len(found) == 1 else ""
