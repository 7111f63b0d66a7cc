"""An engineer's view of a rig's host: its logs, the disk of its recordings, its devices, and a new start."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trocar.review.settings.checking import last_line, run_check
from trocar.services.runtime.bus.endpoints import run_directory
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError, UserError

_TAIL_BYTES = 64 << 10  # some five hundred lines, as long as a person scrolls back


class Host:
    """A rig's host.

    Args:
        rig: The rig; None if its file has an error.
        asked: Name or file of the rig, and all overrides that it was or would be started with.
        scene: Its scene.
        replays: Folder of the replays that pages have kept.
        is_running: Whether the rig runs, and can be started anew from its page.
    """

    def __init__(
        self,
        rig: Rig | None,
        asked: tuple[str, Sequence[str]],
        scene: str,
        replays: Path | None = None,
        *,
        is_running: bool = True,
    ) -> None:
        self._rig, self._scene, self._replays, self._is_running = rig, scene, replays, is_running
        self._name, self._overrides = asked[0], list(asked[1])

    def told(self) -> dict[str, Any]:
        """Return which files the rig was started with, and its instruments."""
        arms = [
            {"name": each.name, "driver": each.arm.driver, "device": each.arm.device or "",
             "grasp": each.grasp.driver if each.grasp is not None else ""}
            for each in (self._rig.gateway.instruments if self._rig is not None else ())
        ]  # fmt: skip
        return {
            "rig": self._name, "scene": self._scene, "overrides": self._overrides, "instruments": arms,
            "is_running": self._is_running,
        }  # fmt: skip

    def logs(self) -> list[dict[str, Any]]:
        """Return the processes' log files, by name; a rig that ran before has left them. Raises UserError as `disk`."""
        folder = self._log_directory()
        return [_size(path) for path in sorted(folder.glob("*.log")) if path.is_file()]

    def log(self, name: str) -> dict[str, Any]:
        """Return the end of a log. Raises UserError if there is none of the name, or the rig's file has an error."""
        if name not in {each["name"] for each in self.logs()}:
            raise UserError(f"there is no log {name[:64]!r}")
        path = self._log_directory() / name
        size = path.stat().st_size
        with path.open("rb") as file:
            file.seek(max(0, size - _TAIL_BYTES))
            tail = file.read(_TAIL_BYTES)
        return {"name": name, "bytes": size, "text": tail.decode("utf-8", "replace"), "cut": size > _TAIL_BYTES}

    def _sound_rig(self) -> Rig:
        if self._rig is None:
            raise UserError(f"the rig {self._name!r} cannot be read: see its file under Files")
        return self._rig

    def _log_directory(self) -> Path:
        return run_directory(self._sound_rig().transport) / "log"

    def disk(self) -> dict[str, Any]:
        """Return the recordings with their sizes, newest first, and the room on their disk.

        Raises UserError if the rig's file has an error.
        """
        rig = self._sound_rig()
        folder = rig.recorder.directory.absolute()
        files = [_size(path) for path in folder.glob("*.mcap")] if folder.is_dir() else []
        there = next(each for each in (folder, *folder.parents) if each.exists())
        usage = shutil.disk_usage(there)
        kept = [path for path in self._replays.glob("*") if path.is_file()] if self._replays else []
        return {
            "folder": str(folder), "files": sorted(files, key=lambda each: each["at_s"], reverse=True),
            "bytes": sum(each["bytes"] for each in files), "free": usage.free, "total": usage.total,
            "replays": sum(path.stat().st_size for path in kept), "n_replays": len(kept),
            "records": rig.process("recorder").enabled,
        }  # fmt: skip

    def devices(self) -> list[dict[str, Any]]:
        """Return what `trocar doctor` finds at this host. Raises UserError if it cannot say."""
        ran = run_check("trocar.services.cli.app", "doctor", "--rig", self._name, "--json", *self._set())
        try:
            checks: list[dict[str, Any]] = json.loads(ran.stdout)["checks"]
        except (ValueError, KeyError):
            raise UserError(last_line(ran.stderr) or f"doctor ended with {ran.returncode}") from None
        return checks

    def check_start(self) -> None:
        """Refuse what a new start of this rig would be refused for. Raises ConfigError with the sentence."""
        of_rig = json.dumps([self._name, self._scene, self._overrides])
        ran = run_check("trocar.services.cli.check_options", of_rig)
        if ran.returncode:
            raise ConfigError(last_line(ran.stderr) or f"the check ended with {ran.returncode}")

    def _set(self) -> list[str]:
        return [word for override in self._overrides for word in ("--set", override)]


def _size(path: Path) -> dict[str, Any]:
    status = path.stat()
    return {"name": path.name, "bytes": status.st_size, "at_s": status.st_mtime}
