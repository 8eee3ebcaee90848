"""Pins: the fitted mesh as a wireframe over the photo, dragged where it belongs."""
