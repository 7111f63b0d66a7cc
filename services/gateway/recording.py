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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty file is told below
            table: npt.NDArray[np.void] = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True))
    except (OSError, ValueError, IndexError) as error:
        raise DeviceError(f"{path}: is not a csv file with a header line: {error}") from None
    names = table.dtype.names or ()
    missing = [column for column in columns if column not in names]
    if missing:
        raise DeviceError(f"{path}: there is no column {missing[0]}; there are {', '.join(names) or 'none'}")
    if len(table) < 2 or not all(np.isfinite(table[name]).all() for name in names):
        raise DeviceError(f"{path}: needs two rows or more of finite numbers")
    if "time_s" in names and (np.diff(table["time_s"]) <= 0.0).any():
        raise DeviceError(f"{path}: time_s must increase")
    return table
