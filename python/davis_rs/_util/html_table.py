"""Writes tables of HTML for notebooks: what an object shows of itself there. All text is escaped."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence


def html_table(
    title: str, rows: Iterable[Sequence[str]], *, heads: Sequence[str] = (), below: str = "", beside: str = ""
) -> str:
    """Return a table with a line above it; the first cell of each row names it.

    Args:
        title: the line above.
        rows: cells of text, which is escaped.
        heads: of the columns, if there are any.
        below: HTML that follows, such as a picture of :func:`html_picture`; it is not escaped.
        beside: HTML to the right of the table, likewise.
    """
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in heads)
    lines = [
        "<tr><th style='text-align:left'>{}</th>{}</tr>".format(
            html.escape(name), "".join(f"<td style='text-align:left'>{html.escape(cell)}</td>" for cell in cells)
        )
        for name, *cells in rows
    ]
    table = f"<table>{f'<tr>{head}</tr>' if head else ''}{''.join(lines)}</table>"
    if beside:
        table = f"<div style='display:flex;gap:16px;align-items:flex-start'>{table}<div>{beside}</div></div>"
    return f"<div><b>{html.escape(title)}</b>{table}{below}</div>"


def html_picture(png: bytes, width: int) -> str:
    """Return a picture as a part of a page, ``width`` CSS pixels wide; its pixels stay squares."""
    source = base64.b64encode(png).decode()
    return f"<img style='width:{width}px;image-rendering:pixelated' src='data:image/png;base64,{source}'>"


def html_lines(lines: Sequence[Sequence[float]], *, width: int = 360, height: int = 90) -> str:
    """Return a small plot of lines of evenly spaced values, all on one scale: red, green and blue.

    A picture of vectors, because a library that draws may not be there.
    """
    values = [value for line in lines for value in line]
    low, high = min(values), max(values)
    scale = (height - 2) / (high - low) if high > low else 0.0
    drawn = []
    for colour, line in zip(("#ca0020", "#1a7f37", "#0571b0"), lines, strict=False):
        step = width / max(1, len(line) - 1)
        points = " ".join(f"{k * step:.1f},{height - 1 - (value - low) * scale:.1f}" for k, value in enumerate(line))
        drawn.append(f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='1.5'/>")
    frame = f"<rect width='{width}' height='{height}' fill='none' stroke='#bbb'/>"
    return f"<svg width='{width}' height='{height}' style='background:white'>{frame}{''.join(drawn)}</svg>"
