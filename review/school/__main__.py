"""The school's process: ``python -m trocar.review.school FILE LIFELINE``, started and ended with the supervisor."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import asyncio
import logging
import os
import socket
import sys
from contextlib import suppress
from pathlib import Path

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
from trocar.services.supervisor.page.helper import Lifeline
from trocar.services.supervisor.page.page_place import PageFile, read_page_file
from trocar.services.supervisor.page.school import socket_path
from trocar.services.training.site import Site, find_site

_NICE = 5  # as the window's: after the rig, but not after everything else on the machine
_log = logging.getLogger("school")


def _site_of(content: PageFile) -> Site | None:
    try:
        return find_site(content.scene, content.scene_overrides)
    except ConfigError as error:
        _log.warning("errors that need the mouth's place are not judged: %s", error)
        return None


def main(place: Path, lifeline: Lifeline) -> None:
    """Serve until the supervisor ends."""
    with suppress(OSError):
        os.nice(_NICE)
    content = read_page_file(place)
    rig = Rig.model_validate_json(content.rig)
    is_scripted = any(each.arm.driver.endswith("_simulated") for each in rig.gateway.instruments)
    bench = Bench(None, _site_of(content), keeps_guests=not is_scripted)
    path = socket_path(rig.transport)
    path.unlink(missing_ok=True)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    sock.bind(str(path))
    path.chmod(0o600)
    sock.listen(16)
    listener = AttemptListener(rig, bench.terms(), bench.take_assessment)
    settings = EditableSettings(ConfigurationFiles(), Host(rig, content.asked, content.scene, folder_of(None)))
    server = make_server(build_app(bench, settings))
    try:
        asyncio.run(serve_until(server, sock, lambda: not lifeline.beat()))
    finally:
        listener.close()
        path.unlink(missing_ok=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Lifeline.of(int(sys.argv[2])))
