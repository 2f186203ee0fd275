"""Mutual TLS: the settings of both sides, and what is wrong where no session comes about."""

import socket
import ssl
from contextlib import suppress
from typing import Any

from sumo_dist.authority.folder import KeyFolder
from sumo_dist.authority.store import CA, CERTIFICATE, KEY

PROBE_S = 1.0
_EXPIRED, _OTHER_NAME = 10, (62, 64)  # OpenSSL's X509_V_ERR_CERT_HAS_EXPIRED, HOSTNAME_, IP_...
_REFUSALS = {  # what a router answers to a client's certificate, in OpenSSL's words
    "CERTIFICATE_EXPIRED": "it has expired by the router's clock",
    "UNKNOWN_CA": "another authority has issued it",
    "DECRYPT_ERROR": "another authority of the same name has issued it",
    "BAD_CERTIFICATE": "the router finds it damaged",
    "CERTIFICATE_REQUIRED": "there is none",
}


def client_settings(keys: KeyFolder) -> dict[str, Any]:
    """Return Zenoh's settings of a client."""
    return {
        "transport/link/tls": {
            "root_ca_certificate": keys.file(CA),
            "connect_certificate": keys.file(CERTIFICATE),
            "connect_private_key": keys.file(KEY),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
    }


def router_settings(keys: KeyFolder) -> dict[str, Any]:
    """Return Zenoh's settings of a router."""
    return {
        "transport/link/tls": {
            "root_ca_certificate": keys.file(CA),
            "listen_certificate": keys.file(CERTIFICATE),
            "listen_private_key": keys.file(KEY),
            "enable_mtls": True,
            "close_link_on_expiration": True,
        }
    }


def why_not(endpoint: str, address: tuple[str, int], keys: KeyFolder | None) -> str:
    """Say why a router that is there gives no session; "" if nothing is wrong with the keys.

    Args:
        endpoint: as it was dialled.
        address: its host and port.
        keys: that were shown.
    """
    if endpoint.startswith("tcp/"):
        return _wants_tls(address)
    return _refused(address, keys) if keys is not None else ""


def _wants_tls(address: tuple[str, int]) -> str:
    """Say so if a router that was dialled without TLS speaks nothing else."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with _connected(address) as plain, context.wrap_socket(plain):
            pass
    except (OSError, ValueError):
        return ""
    host, port = address
    return (
        f"the router at {host}:{port} wants TLS: dial tls/{host}:{port} with --keys DIR, this "
        "host's folder from `sumo-dist keys host`"
    )


def _refused(address: tuple[str, int], keys: KeyFolder) -> str:
    """Say which side refuses the other's certificate, if one does."""
    context = ssl.create_default_context(cafile=keys.file(CA))
    context.load_cert_chain(keys.file(CERTIFICATE), keys.file(KEY))
    host, port = address
    where = f"the router at {host}:{port}"
    try:
        with (
            _connected(address) as plain,
            context.wrap_socket(plain, server_hostname=host) as secure,
            suppress(TimeoutError),  # it waits for us to speak: all is well
        ):
            secure.recv(1)
    except ssl.SSLCertVerificationError as error:
        if error.verify_code == _EXPIRED:
            return f"the certificate of {where} has expired: `sumo-dist keys renew` its host"
        if error.verify_code in _OTHER_NAME:
            return (
                f"the certificate of {where} does not name {host}: dial it by a name that it has, "
                f"or issue it again with `sumo-dist keys host ... --address {host}`"
            )
        return (
            f"the certificate of {where} is not of the authority of {keys.file(CA)} "
            f"({error.verify_message})"
        )
    except ssl.SSLError as error:
        for alert, reason in _REFUSALS.items():
            if alert in str(error.reason):
                return f"{where} refuses {keys.file(CERTIFICATE)}: {reason}"
        if "WRONG_VERSION" in str(error.reason) or "EOF" in str(error):
            return f"{where} does not speak TLS: dial tcp/{host}:{port}, or is it another program"
    except OSError:
        pass
    return ""


def _connected(address: tuple[str, int]) -> socket.socket:
    return socket.create_connection(address, PROBE_S)
