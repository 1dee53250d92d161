"""A scene as flat tables: what the native renderer and the table kernel take."""
