"""Event files of any format: read, written, converted."""
