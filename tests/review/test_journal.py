"""The journal of what instructors did: a line that was cut loses itself, and nothing else."""

from pathlib import Path

from trocar.review.journal import ActJournal


def test_acts_come_back_the_newest_first(tmp_path: Path) -> None:
    journal = ActJournal(tmp_path / "new" / "acts.journal")
    assert journal.last() == []
    for k in range(3):
        journal.write({"by": "instructor", "act": k})
    assert [each["act"] for each in journal.last()] == [2, 1, 0]
    assert [each["act"] for each in journal.last(2)] == [2, 1]


def test_a_line_that_a_full_disk_has_cut_spoils_neither_those_before_nor_the_next(tmp_path: Path) -> None:
    journal = ActJournal(tmp_path / "acts.journal")
    journal.write({"act": "before"})
    whole = journal.path.read_bytes()
    for cut in (1, 12, len(whole) - 1):
        journal.path.write_bytes(whole + whole[:cut])
        journal.write({"act": "after"})
        assert journal.last()[0]["act"] == "after"
        assert journal.last()[-1]["act"] == "before"


def test_lines_that_are_no_acts_are_left_out(tmp_path: Path) -> None:
    journal = ActJournal(tmp_path / "acts.journal")
    journal.path.write_bytes(b'\xff\xfe\n[1]\n"x"\n\n{"act": "kept"}\n')
    assert journal.last() == [{"act": "kept"}]
