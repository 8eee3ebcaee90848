"""Photographs whose truth is known: people of the face model, rendered by Cycles."""
