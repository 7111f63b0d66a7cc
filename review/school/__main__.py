"""The school's process: ``python -m trocar.review.school LINK``, started by the supervisor only, and ended with it."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import asyncio
import logging
import os
import socket
import sys
from contextlib import suppress

from trocar.review.school.app import build_app
from trocar.review.school.bench import Bench
from trocar.review.school.listening import AttemptListener
from trocar.review.school.replays import folder_of
from trocar.review.school.settings_routes import EditableSettings
from trocar.review.settings.files import ConfigurationFiles
from trocar.review.settings.host import Host
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.web.web_server import make_server, serve_until
from trocar.services.supervisor.page.page_link import Link, PageSetup
from trocar.services.supervisor.page.school import socket_path
from trocar.services.training.site import Site, find_site

_NICE = 5  # as the window's: after the rig, but not after everything else on the machine
_log = logging.getLogger("school")


def _site_of(setup: PageSetup) -> Site | None:
    try:
        return find_site(setup.scene, setup.scene_overrides)
    except ConfigError as error:
        _log.warning("errors that need the mouth's place are not judged: %s", error)
        return None


def _has_ended(link: Link) -> bool:
    """Return whether the supervisor has ended."""
    try:
        link.receive(PageSetup)
    except ConnectionError:
        return True
    return False


def main(descriptor: int) -> int:
    """Serve until the supervisor ends; return the exit code."""
    with suppress(OSError):
        os.nice(_NICE)
    link = Link(socket.socket(fileno=descriptor))
    setup = link.wait(PageSetup)
    if setup is None:
        return 1
    rig = Rig.model_validate_json(setup.rig)
    is_scripted = any(each.arm.driver.endswith("_simulated") for each in rig.gateway.instruments)
    bench = Bench(None, _site_of(setup), keeps_guests=not is_scripted)
    path = socket_path(rig.transport)
    path.unlink(missing_ok=True)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    sock.bind(str(path))
    path.chmod(0o600)
    sock.listen(16)
    listener = AttemptListener(rig, bench.terms(), bench.take_assessment)
    settings = EditableSettings(ConfigurationFiles(), Host(rig, setup.asked, setup.scene, folder_of(None)))
    server = make_server(build_app(bench, settings))
    try:
        asyncio.run(serve_until(server, sock, lambda: _has_ended(link)))
    finally:
        listener.close()
        path.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
