"""What pages quote of committed tables is what the tables have now."""

from __future__ import annotations

import pytest

from tests.docs import quoted
from tests.docs.quoted import QUOTES, ROOT, Quote, with_figures

VALUES = quoted.figures()


@pytest.mark.parametrize("quote", QUOTES, ids=[f"{each.page}: {each.passage[:40]}" for each in QUOTES])
def test_a_figure_on_a_page_is_that_of_the_table(quote: Quote) -> None:
    found = quoted.quoted(quote, (ROOT / quote.page).read_text(encoding="utf-8"))
    expected = [VALUES[name] for name in quote.names()]
    assert found == expected, "run `python -m tests.docs.quoted`"


def test_every_figure_that_is_made_is_quoted_or_goes_with_one_that_is() -> None:
    assert {name for quote in QUOTES for name in quote.names()} <= VALUES.keys()


def test_a_stale_figure_is_found_and_mended_across_a_line_break() -> None:
    quote, text = Quote("page", "It takes {long} us, not {short} us."), "So: It takes\n250 us, not **7** us. And 250."
    assert quoted.quoted(quote, text) == ["250", "**7**"]
    mended = with_figures(quote, text, {"long": "93", "short": "183"})
    assert mended == "So: It takes\n93 us, not 183 us. And 250."


@pytest.mark.parametrize("text", ["", "It takes 1 us. It takes 2 us."])
def test_a_passage_that_is_gone_or_ambiguous_is_told(text: str) -> None:
    with pytest.raises(ValueError, match=r"page holds \d times: It takes"):
        quoted.quoted(Quote("page", "It takes {us} us."), text)
