"""Skin that changes through a film: what is left over of its pictures once head, face and light
are explained (docs/sequences.md).
"""
