"""GLOMAP and COLMAP through pycolmap: the only place that imports it."""
