"""HTML and SVG elements as text: whatever is put into them is escaped."""

from __future__ import annotations

import html
from typing import Final

_WITHOUT_END: Final = frozenset({"br", "hr", "img", "meta", "link"})


class Html(str):
    """Text that is HTML already, and is not escaped again."""

    __slots__ = ()


def element(name: str, *children: str, **attributes: str | float | bool | None) -> Html:
    """Returns an element.

    Args:
        name: Such as `p` or `circle`.
        children: What is in it; a string that is no Html is escaped.
        attributes: `class_` stands for class, and underscores for hyphens. None leaves an
            attribute out, True gives it no value. Numbers are written short.
    """
    texts = [name, *filter(None, (_attribute(key, value) for key, value in attributes.items()))]
    start = f"<{' '.join(texts)}>"
    return Html(start if name in _WITHOUT_END else f"{start}{joined(*children)}</{name}>")


def joined(*children: str) -> Html:
    """Returns pieces one after the other, those that are no Html escaped."""
    return Html(
        "".join(c if isinstance(c, Html) else html.escape(c, quote=False) for c in children)
    )


def _attribute(name: str, value: str | float | bool | None) -> str:
    name = name.rstrip("_").replace("_", "-")
    if value is None or value is False:
        return ""
    if value is True:
        return name
    text = value if isinstance(value, str) else f"{value:.6g}"
    return f'{name}="{html.escape(text)}"'
