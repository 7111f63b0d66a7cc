"""Recordings of devices as csv files: a header line, one row per sample, SI units."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from services.runtime.errors import DeviceError


def read_table(path: Path, columns: tuple[str, ...]) -> npt.NDArray[np.void]:
    """Return a csv file with a header line as a structured array of two rows or more, in the order of its time.

    Raises
    ------
    DeviceError
        naming the file, if it cannot be read, lacks one of `columns`, or holds something else than finite numbers; or
        if ``time_s``, where it is there, does not increase.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        if not any(line.strip() for line in lines):
            raise DeviceError(f"{path}: the file is empty")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a header alone is told below
            table: npt.NDArray[np.void] = np.atleast_1d(np.genfromtxt(lines, delimiter=",", names=True))
    except OSError as error:
        raise DeviceError(f"{path}: {error.strerror}") from None
    except (ValueError, IndexError) as error:
        raise DeviceError(f"{path}: is not a csv file with a header line: {' '.join(str(error).split())}") from None
    names = table.dtype.names or ()
    missing = [column for column in columns if column not in names]
    if missing:
        raise DeviceError(f"{path}: there is no column {missing[0]}; there are {', '.join(names) or 'none'}")
    if len(table) < 2:
        raise DeviceError(f"{path}: needs two rows or more of finite numbers, has {len(table)}")
    for name in names:
        wrong = np.flatnonzero(~np.isfinite(table[name]))
        if len(wrong):
            raise DeviceError(f"{path}: row {wrong[0] + 1} below the header: {name} is not a finite number")
    if "time_s" in names and (np.diff(table["time_s"]) <= 0.0).any():
        raise DeviceError(f"{path}: time_s must increase")
    return table
