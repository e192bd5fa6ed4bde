"""Tables of a run as HTML, the best value of each column set apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from mnsf_ros.evaluation.tables import TextTable
from mnsf_ros.report.html import Html, element, joined

# Beginnings of column titles and whether less is better; columns that are not here have no best.
_LESS_IS_BETTER: Final = {
    "EPE": True,
    "Acc": False,
    "Outliers": True,
    "angle": True,
    "time (ms)": True,
}


# Rows that are no competitors: they say what an error of nothing done at all is worth.
REFERENCES: Final = frozenset({"zero", "ego"})


def result_table(
    table: TextTable, note: str = "", *, mark_all: bool = False, are_rivals: bool = True
) -> Html:
    """Returns a table in a card.

    Args:
        table: What it shows.
        note: A line below the title.
        mark_all: Whether less is better in every column.
        are_rivals: Whether rows compete for the best value.
    """
    best = [
        _best_text(table, k, mark_all) if are_rivals else None for k in range(len(table.header))
    ]
    head = element("tr", *(element("th", title, scope="col") for title in table.header))
    body = [
        element(
            "tr",
            element("th", row[0], scope="row"),
            *(_cell(row[0], text, best[place]) for place, text in enumerate(row) if place),
        )
        for row in table.rows
    ]
    words = [element("b", table.title)] + ([element("br"), note] if note else [])
    inner = element(
        "table",
        element("caption", *words) if table.title else "",
        element("thead", head),
        element("tbody", *body),
    )
    return element("div", element("div", inner, class_="scroll"), class_="card long")


def words_table(rows: Sequence[tuple[str, str]], header: tuple[str, str]) -> Html:
    """Returns a table of names and words."""
    head = element("tr", *(element("th", title, scope="col") for title in header))
    body = [
        element("tr", element("th", name, scope="row"), element("td", text)) for name, text in rows
    ]
    return element("table", element("thead", head), element("tbody", *body), class_="words")


def _cell(name: str, text: str, best: str | None) -> Html:
    if text == best and name not in REFERENCES:
        return element("td", text, class_="best")
    return element("td", text)


def _best_text(table: TextTable, place: int, mark_all: bool) -> str | None:
    """The text of the best value of a column; None if there is nothing to choose from."""
    title = table.header[place]
    kinds = [less for start, less in _LESS_IS_BETTER.items() if title.startswith(start)]
    is_less_better = True if mark_all else (kinds[0] if kinds else None)
    if place == 0 or is_less_better is None:
        return None
    rivals = [row for row in table.rows if row[0] not in REFERENCES]
    numbers = {row[place]: _number(row[place]) for row in rivals}
    known = {text: value for text, value in numbers.items() if not math.isnan(value)}
    if len(known) < 2:
        return None
    choose = min if is_less_better else max
    return choose(known, key=lambda text: known[text])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def fact_list(facts: Sequence[tuple[str, str]]) -> Html:
    """Returns names with what is to be said about each; without those that have nothing."""
    parts = [
        joined(element("dt", name), element("dd", text)) for name, text in facts if text.strip()
    ]
    return element("dl", *parts)
