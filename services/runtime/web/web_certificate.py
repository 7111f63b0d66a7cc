"""The certificate by which the rig's web servers are encrypted: made by `trocar keys`, signed by itself.

Nobody else vouches for it. A program knows it by its fingerprint; a person compares the fingerprint that the browser
shows with the one that the rig has printed.
"""

from __future__ import annotations

import datetime
import hashlib
import ipaddress
import os
import socket
import ssl
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError

if TYPE_CHECKING:
    from cryptography.x509 import GeneralName

_CERTIFICATE, _KEY = "page.crt", "page.key_secret"
#: Browsers refuse a certificate that is valid for longer, also one that its user has imported.
VALID = datetime.timedelta(days=825)
#: An address that nobody has (RFC 5737): to it this host would send from the address by which others reach it.
_NOBODY = "192.0.2.1", 9


@dataclass(frozen=True, slots=True)
class Certificate:
    """Files of a certificate and its private key, both readable and of one pair, and what they say."""

    file: Path
    key_file: Path
    fingerprint: str
    until: datetime.datetime

    def server_options(self) -> dict[str, str]:
        """Return the options by which `uvicorn.Config` serves with it."""
        return {"ssl_certfile": str(self.file), "ssl_keyfile": str(self.key_file)}


def is_there(directory: Path) -> bool:
    """Return whether `directory` holds a certificate, or a part of one."""
    return (directory / _CERTIFICATE).exists() or (directory / _KEY).exists()


def own_names() -> tuple[str, ...]:
    """Return the names and addresses by which this host is reached."""
    found = ["localhost", "127.0.0.1", "::1", socket.gethostname().lower()]
    for family in (socket.AF_INET, socket.AF_INET6):
        with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect(_NOBODY if family == socket.AF_INET else ("2001:db8::1", 9))
            found.append(probe.getsockname()[0])
    return tuple(dict.fromkeys(found))


def make(directory: Path, names: Iterable[str]) -> Certificate:
    """Create a certificate for hosts of these names and addresses in `directory`, its key readable by this user only.

    Raises ConfigError if one is there, a name cannot be a host's, or the directory is not writable.
    """
    if is_there(directory):
        raise ConfigError(f"{directory / _CERTIFICATE} is there already; remove it and {_KEY} to make a new one")
    certificate, key = _sign(tuple(names))
    try:
        directory.mkdir(parents=True, exist_ok=True)
        _write(directory / _KEY, key, 0o600)
        _write(directory / _CERTIFICATE, certificate, 0o644)
    except OSError as error:
        for name in (_KEY, _CERTIFICATE):  # otherwise half of it would "be there already" the next time
            (directory / name).unlink(missing_ok=True)
        raise ConfigError(f"{directory}: the certificate cannot be written: {error.strerror}") from None
    return load(directory)


def load(directory: Path) -> Certificate:
    """Return the certificate in `directory`.

    Raises ConfigError naming a file that is missing, open to others or invalid, or a certificate that has expired.
    """
    from cryptography import x509

    file, key_file = directory / _CERTIFICATE, directory / _KEY
    try:
        if key_file.stat().st_mode & 0o077:
            raise ConfigError(f"{key_file} can be read by others: `chmod 600 {key_file}`")
        read = x509.load_pem_x509_certificate(file.read_bytes())
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(file, key_file, lambda: "")
    except ssl.SSLError as error:
        raise ConfigError(f"supervisor.web.keys: {file} and {key_file} are no pair: {error.reason or error}") from None
    except OSError as error:
        where = error.filename or directory
        raise ConfigError(f"supervisor.web.keys: {where}: {error.strerror}; `trocar keys` makes it") from None
    except ValueError as error:
        raise ConfigError(f"supervisor.web.keys: {file} holds no certificate: {error}") from None
    until = read.not_valid_after_utc
    if until <= datetime.datetime.now(datetime.UTC):
        raise ConfigError(
            f"supervisor.web.keys: {file} was valid until {until:%Y-%m-%d}: remove it and {_KEY}, and `trocar keys "
            f"{directory}` makes a new one"
        )
    return Certificate(file, key_file, fingerprint_of(ssl.PEM_cert_to_DER_cert(file.read_text())), until)


def load_for(rig: Rig) -> Certificate | None:
    """Return the certificate of a rig's web servers, None if it serves without; raises as `load` does."""
    keys = rig.supervisor.web.keys
    return None if keys is None else load(keys)


def fingerprint_of(der: bytes) -> str:
    """Return the SHA-256 fingerprint of a certificate as browsers show it: ``AB:CD:...``."""
    return hashlib.sha256(der).digest().hex(":").upper()


def _sign(names: tuple[str, ...]) -> tuple[bytes, bytes]:
    """Return a certificate that is signed by its own key, and the key, as PEM."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "Trocar rig")])
    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # the clocks of a class differ
        .not_valid_after(now + VALID - datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([_general_name(each) for each in names]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
    )
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM), private


def _general_name(name: str) -> GeneralName:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        pass
    if not name or name.startswith(".") or not all(each.isalnum() or each in "-._" for each in name):
        raise ConfigError(f"--name {name!r} is neither a host's name nor an address")
    try:
        return x509.DNSName(name.encode("idna").decode())
    except (ValueError, UnicodeError):
        raise ConfigError(f"--name {name!r} is neither a host's name nor an address") from None


def _write(path: Path, data: bytes, mode: int) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(data)
