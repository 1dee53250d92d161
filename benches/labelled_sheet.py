"""Puts pictures into a sheet with a name for each row and column."""

from __future__ import annotations

from collections.abc import Mapping

from PIL import Image, ImageDraw, ImageFont

GAP, TEXT = 8, 15


def labelled_sheet(rows: Mapping[str, Mapping[str, Image.Image]]) -> Image.Image:
    """Return a grey sheet of pictures by the names of their rows and columns.

    A column is as wide as its widest picture, a row as high as its highest one. A row may lack pictures. Columns come
    in the order of the row that has most of them.
    """
    font, ruler = ImageFont.load_default(TEXT), ImageDraw.Draw(Image.new("L", (1, 1)))
    columns = list(dict.fromkeys(name for row in sorted(rows.values(), key=len, reverse=True) for name in row))
    left, top = int(max(ruler.textlength(name, font) for name in rows)) + 2 * GAP, TEXT + 2 * GAP
    widths = [max(row[name].width for row in rows.values() if name in row) + GAP for name in columns]
    heights = [max(image.height for image in row.values()) + GAP for row in rows.values()]
    sheet = Image.new("L", (left + sum(widths), top + sum(heights)), 255)
    draw = ImageDraw.Draw(sheet)
    for k, name in enumerate(columns):
        draw.text((left + sum(widths[:k]), GAP), name, fill=0, font=font)
    for number, (name, row) in enumerate(rows.items()):
        y = top + sum(heights[:number])
        draw.text((GAP, y + heights[number] // 2), name, fill=0, font=font, anchor="lm")
        for k, column in enumerate(columns):
            if column in row:
                sheet.paste(row[column], (left + sum(widths[:k]), y))
    return sheet
