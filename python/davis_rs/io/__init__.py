"""Files: event formats, dataset folders and recordings of cameras."""
