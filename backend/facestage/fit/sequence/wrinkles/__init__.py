"""Wrinkles that come with an expression: heights that follow sliders (docs/sequences.md)."""
