"""Keys of a rig on several hosts: CurveZMQ, with one key pair for all processes of a rig.

Every process proves that it has the pair, as publisher and as reader, and every frame is encrypted. libzmq sends
authentication requests to a ZAP socket of the same context (rfc.zeromq.org/spec/27). pyzmq answers them in a thread,
which a 1 kHz loop cannot afford, so the bus answers when it sends.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import zmq
import zmq.auth
from zmq.utils import z85

from trocar.services.runtime.errors import ConfigError

_NAME = "rig"
_ZAP = "inproc://zeromq.zap.01"
_DOMAIN = b"trocar"
#: Most requests answered at once; others wait for the next call.
_ANSWERS = 16
_BREACHES_KEPT = 100_000  # between two looks, ten times a second


@dataclass(frozen=True, slots=True)
class Keys:
    """The rig's key pair, in Z85."""

    public: bytes
    secret: bytes

    def guard_publisher(self, socket: zmq.Socket[bytes]) -> None:
        """Restrict `socket`, before it binds, to holders of the keys."""
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret)
        socket.setsockopt(zmq.ZAP_DOMAIN, _DOMAIN)

    def guard_reader(self, socket: zmq.Socket[bytes]) -> None:
        """Restrict `socket`, before it connects, to a publisher with the keys."""
        socket.setsockopt(zmq.CURVE_SERVERKEY, self.public)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, self.public)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret)


class ZapAuthenticator:
    """Authenticates readers of the publishers of a context; must exist before they bind."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], keys: Keys) -> None:
        self._keys = keys
        self._public = z85.decode(keys.public)
        self._socket = context.socket(zmq.ROUTER)
        self._socket.bind(_ZAP)
        self._context = context
        self._watched: list[tuple[zmq.Socket[bytes], zmq.Socket[bytes], str]] = []
        self._breaches = self.refused = 0

    def guard_publisher(self, socket: zmq.Socket[bytes]) -> None:
        """Restrict `socket`, before it binds, to holders of the keys, and count other peers."""
        self._keys.guard_publisher(socket)
        # For a reader without keys it may only see a disconnection.
        self._watch(socket, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL)

    def guard_reader(self, socket: zmq.Socket[bytes], where: str) -> None:
        """Restrict `socket`, before it connects to `where`, to a publisher with the keys, and count others."""
        self._keys.guard_reader(socket)
        self._watch(socket, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL, where)

    def _watch(self, socket: zmq.Socket[bytes], events: int, where: str = "") -> None:
        """Monitor failed handshakes and connections: wrong keys, repeated or changed bytes."""
        name = f"inproc://watched-{len(self._watched)}"
        socket.monitor(name, events)
        watched = self._context.socket(zmq.PAIR)
        watched.rcvhwm = _BREACHES_KEPT  # libzmq blocks when the queue is full
        watched.connect(name)
        self._watched.append((watched, socket, where))

    def breaches(self) -> int:
        """Return the number of these. A reader with one reconnects here, as libzmq never would."""
        for watched, socket, where in self._watched:
            before = self._breaches
            with suppress(zmq.Again):
                while watched.recv_multipart(zmq.NOBLOCK):
                    self._breaches += 1
            if where and self._breaches > before:
                socket.disconnect(where)
                socket.connect(where)
        return self._breaches

    def answer(self) -> None:
        """Answer pending requests. Never blocks."""
        for _ in range(_ANSWERS):
            try:
                parts = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._socket.send_multipart(self._reply(parts))

    def _reply(self, parts: list[bytes]) -> list[bytes]:
        """Return the reply to ``[peer, "", version, request id, domain, address, identity, mechanism, key]``."""
        known = len(parts) == 9 and parts[7] == b"CURVE" and parts[8] == self._public
        self.refused += not known
        status = [b"200", b"OK"] if known else [b"400", b"this rig has other keys"]
        return [*parts[:2], b"1.0", parts[3], *status, b"", b""]


def is_there(directory: Path) -> bool:
    """Return whether `directory` holds the keys of a rig."""
    return (directory / f"{_NAME}.key_secret").exists()


def make(directory: Path) -> Path:
    """Create the keys of a rig in `directory`, readable by this user only, and return the secret's file.

    Raises ConfigError if keys exist already, or the directory is not writable.
    """
    file = directory / f"{_NAME}.key_secret"
    if is_there(directory):
        raise ConfigError(f"{file} is there already: a rig whose keys change must restart on every host")
    mask = os.umask(0o077)  # the secret is private even while it is written
    try:
        directory.mkdir(parents=True, exist_ok=True)
        zmq.auth.create_certificates(directory, _NAME)
    except OSError as error:
        file.unlink(missing_ok=True)  # otherwise an incomplete one would "exist already" the next time
        raise ConfigError(f"{directory}: keys cannot be written: {error.strerror}") from None
    finally:
        os.umask(mask)
    return file


def load(directory: Path) -> Keys:
    """Return the keys in `directory`. Raises ConfigError naming a missing, public or invalid file."""
    file = directory / f"{_NAME}.key_secret"
    try:
        if file.stat().st_mode & 0o077:
            raise ConfigError(f"{file} can be read by others: `chmod 600 {file}`")
        public, secret = zmq.auth.load_certificate(file)
    except OSError as error:
        raise ConfigError(f"transport.keys: {file}: {error.strerror or error}; `trocar keys` makes it") from None
    except ValueError as error:
        raise ConfigError(f"transport.keys: {file} holds no keys: {error}") from None
    if secret is None:
        raise ConfigError(f"transport.keys: {file} holds no secret key; copy the one that `trocar keys` made")
    return Keys(public, secret)
