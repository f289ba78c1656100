"""Colours, layouts, axes, texts and markup that panels share."""
