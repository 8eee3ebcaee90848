"""Operators and panels: each gathers plain values, calls one function elsewhere, and reports."""
