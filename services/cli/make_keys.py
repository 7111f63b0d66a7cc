"""``trocar keys``: the key pair of a rig on several hosts, and the certificate of its page."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from trocar.services.runtime.bus import keys
from trocar.services.runtime.web import web_certificate


def run_keys(directory: Path, names: tuple[str, ...], as_json: bool) -> None:
    """Make the keys and the certificate, and say what to do with them.

    To keys that an older version has made the certificate is added. Raises ConfigError if both are there.
    """
    secret = None
    if not keys.is_there(directory) or web_certificate.is_there(directory):
        secret = keys.make(directory)
    names = tuple(dict.fromkeys((*web_certificate.own_names(), *names)))
    made = web_certificate.make(directory, names)
    if as_json:
        told = {"certificate": str(made.file), "fingerprint": made.fingerprint, "names": names}
        print(json.dumps(told if secret is None else {"secret": str(secret), **told}))
        return
    if secret is not None:
        print(
            f"made {secret}: copy it to every host of the rig, keep it as secret as the rig is, and set transport.keys",
            file=sys.stderr,
        )
    print(
        f"made {made.file}, for {', '.join(names)}, valid until {made.until:%Y-%m-%d}: set supervisor.web.keys, and "
        f"compare with what the browser shows its SHA-256 fingerprint {made.fingerprint}",
        file=sys.stderr,
    )
