"""Chooses Mitsuba's variant once per process, before anything of it is used."""

from __future__ import annotations

import mitsuba as mi

from facestage.native import LLVM_VARIANT, choose_variant, ensure_llvm


def start_renderer(device: str = "auto") -> str:
    """Select the variant for ``device`` (auto, cpu, cuda) and return its name.

    Raises BackendUnavailableError when no renderer works here.
    """
    variant = choose_variant(device)
    if variant == LLVM_VARIANT:
        ensure_llvm()
    if mi.variant() != variant:
        mi.set_variant(variant)
    return variant
