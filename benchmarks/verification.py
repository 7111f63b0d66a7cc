"""Write docs/verification.md: every published or independent number this project is checked against.

    python benchmarks/verification.py

Each ``verification_*.py`` beside this file has ``tables() -> list[Table]``.
"""

from __future__ import annotations

import importlib
from pathlib import Path

from report import parse

HERE = Path(__file__).resolve().parent
TARGET = HERE.parent / "docs" / "verification.md"
HEADER = """# Verification

Made by `python benchmarks/verification.py`; do not edit by hand. Error is value / reference - 1. "Source" says where
the reference number comes from; *computed* means another solver or a semi-analytic method, *unverified* a standard
literature value that was not checked against the printed source. The tests hold the same numbers to tolerances.
"""


def main() -> None:
    parse(__doc__)
    modules = sorted(p.stem for p in HERE.glob("verification_*.py") if p.stem != "verification_table")
    sections = [table.to_markdown() for name in modules for table in importlib.import_module(name).tables()]
    TARGET.write_text("\n".join([HEADER, *sections]))
    print(f"{TARGET}: {len(sections)} tables")


if __name__ == "__main__":
    main()
