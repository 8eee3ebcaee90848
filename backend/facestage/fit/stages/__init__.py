"""Stages: what moves when: phases, the view of one photo, start values, the joint stage of several
photos.

May import energy, solve and what those may import.
"""
