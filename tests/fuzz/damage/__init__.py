"""Damage: a valid input with small faults put into it, by the kind of file."""
