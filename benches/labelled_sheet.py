"""Puts pictures into a sheet with a name for each row and column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from PIL import Image, ImageDraw, ImageFont

GAP, TEXT = 8, 15


def labelled_sheet(rows: Mapping[str, Sequence[Image.Image]], columns: Sequence[str]) -> Image.Image:
    """Return a grey picture; a column is as wide as its widest picture, a row as high as its highest one."""
    font = ImageFont.load_default(TEXT)
    left = int(max(font.getlength(name) for name in rows)) + 2 * GAP
    top = TEXT + 2 * GAP
    widths = [max(images[k].width for images in rows.values() if k < len(images)) + GAP for k in range(len(columns))]
    heights = [max(image.height for image in images) + GAP for images in rows.values()]
    sheet = Image.new("L", (left + sum(widths), top + sum(heights)), 255)
    draw = ImageDraw.Draw(sheet)
    for k, name in enumerate(columns):
        draw.text((left + sum(widths[:k]), GAP), name, fill=0, font=font)
    for number, (name, images) in enumerate(rows.items()):
        y = top + sum(heights[:number])
        draw.text((GAP, y + images[0].height // 2), name, fill=0, font=font, anchor="lm")
        for k, image in enumerate(images):
            sheet.paste(image, (left + sum(widths[:k]), y))
    return sheet
