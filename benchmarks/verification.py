"""Write docs/results/verification.md: every published or independent number this project is checked against.

    python benchmarks/verification.py

Each ``verification_*.py`` beside this file has ``tables() -> list[Table]``.
"""

from __future__ import annotations

import importlib
from pathlib import Path

from report import parse

HERE = Path(__file__).resolve().parent
TARGET = HERE.parent / "docs" / "results" / "verification.md"
HEADER = """# Verification

Every published or independent number that this project is checked against. Made by `python benchmarks/verification.py`;
do not edit by hand. The error is value / reference - 1; several errors stand in the order of their meshes. Reference
and mesh above a table hold for each row that does not name others. *Computed* means another solver or a semi-analytic
method. *Unverified* means a value of the literature that was not checked against the printed source. The tests hold the
same numbers to tolerances.
"""


def main() -> None:
    parse(__doc__)
    modules = sorted(p.stem for p in HERE.glob("verification_*.py") if p.stem != "verification_table")
    sections = [table.to_markdown() for name in modules for table in importlib.import_module(name).tables()]
    TARGET.write_text("\n".join([HEADER, *sections]))
    print(f"{TARGET}: {len(sections)} tables")


if __name__ == "__main__":
    main()
