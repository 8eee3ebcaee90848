"""Facestage without a window: the way from a photo to a .blend, and the commands that go it."""
