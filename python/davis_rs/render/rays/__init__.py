"""A camera's rays, and where shadow rays begin and end."""
