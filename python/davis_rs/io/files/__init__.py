"""Reads, writes and converts event files of any format. Dataset folders are one of the formats here."""

from ..dataset.folder_format import FolderFormat
from ..formats.registry import register

register(FolderFormat())
