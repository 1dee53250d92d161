"""A DAVIS on the USB, and one in software."""
