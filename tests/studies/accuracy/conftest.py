"""Runs of studies on their smallest sizes, shared by the tests."""

import pytest

from trocar.studies.accuracy.log import StudyLog
from trocar.studies.accuracy.run import fill_costs, fill_errors, table
from trocar.studies.accuracy.study import Draw, Size
from trocar.studies.accuracy.workers import open_workers

SMALLEST = Draw(Size.SMALLEST, 1)


def silent(what, done, total):
    pass


@pytest.fixture(scope="session")
def run_smallest(tmp_path_factory):
    """Return rows of studies, and the log that has them: of a folder, else of one in which each is computed once."""
    shared = tmp_path_factory.mktemp("studies")

    def run(*names, folder=None, costs=True, scheduler=None):
        log = StudyLog(folder or shared, SMALLEST, "code")
        with open_workers(1, scheduler) as workers:
            fill_errors(names, SMALLEST, log, workers, silent)
        if costs:
            fill_costs(names, SMALLEST, log, silent)
        return table(names, SMALLEST, log), log

    return run
